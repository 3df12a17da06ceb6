#pragma once
// What the window remembers from one start to the next, in a JSON file of the user's.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "client/viewer/viewer_state.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::viewer {

struct Remembered {
  // The last place in a session of a server.
  struct Place {
    std::string where;  // "host:port/session"
    lattice::Point at;
    double altitude = 150, yaw = 0, pitch = -10;  // metres above the ground; degrees
  };
  static constexpr std::size_t kMaxPlaces = 50;  // those longest not visited are forgotten

  std::uint32_t width = 1280, height = 720;  // of the window, screen coordinates before the screen's scale
  double divider = 0.5, speed = 50, textScale = 1;
  Mode mode = Mode::kSplit;
  Borders borders = Borders::kNone;
  bool figures = true, plots = false, wireframe = false, smooth = true, invertY = false, vsync = true, members = true;
  std::string name;           // the user's; at most 32 bytes
  std::vector<Place> places;  // the last visited first

  const Place* placeAt(const std::string& where) const;  // null: never visited
  void visit(Place place);
};

std::string sessionAt(const core::Url& url);  // a place's `where`

// $XDG_CONFIG_HOME/ridgecast/window.json, or ~/.config/ridgecast/window.json; null without either variable (absolute).
std::optional<std::filesystem::path> rememberedFile();

// The defaults if there is no such file. Error: one sentence that names the file and what is wrong, for instance a value outside of its
// range; at most 64 KiB are read.
Outcome<Remembered> readRemembered(const std::filesystem::path& file);

// Writes into the file what differs between `first` and `last`, and the places that `last` has; what another window has written meanwhile
// stays.
// Makes the folder. The file is replaced whole or not at all. Error: one sentence.
Outcome<void> keepChanges(const std::filesystem::path& file, const Remembered& first, const Remembered& last);

}  // namespace ridgecast::viewer
