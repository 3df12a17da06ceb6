#pragma once
// The dialogs: settings, worlds and places, who is here. Drawn by Dear ImGui. Internal to the room.

#include <cstdint>
#include <optional>
#include <string>

#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {

// What the user requested in the panel since the last frame.
struct Requests {
  bool settings = false, jump = false, world = false, vsync = false;
  std::optional<std::uint64_t> flyTo;  // a member's camera
  std::optional<std::string> session;  // to enter
};

struct Area {
  double left = 0, top = 0, right = 0, bottom = 0;  // screen coordinates
};

// The open dialog. `area`: where it takes the mouse.
Requests drawPanel(ViewerState& state, Area& area);

}  // namespace ridgecast::viewer
