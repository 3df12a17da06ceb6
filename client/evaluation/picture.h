#pragma once
// One picture of a settled mesh from one pose, without a window.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "common/wire/messages.h"

namespace ridgecast::evaluation {

enum class Drawn { kCorrected, kMesh, kMarch };  // the mesh moved onto the true surface (render/correction_pass.h), as it is, the ray march

struct PictureOptions {
  core::Url url;
  // Of a terrain of one's own, with a server of its own: that program and its arguments; empty: the URL's.
  std::filesystem::path server;
  std::vector<std::string> arguments;
  std::filesystem::path out;  // a PNG
  wire::Settings settings;
  std::optional<double> x, z;                // metres; neither: 0, or the middle of a map that lies elsewhere
  double altitude = 150;                     // metres above the ground there
  double yaw = 0, pitch = -10, fov = 60;     // degrees; the field of view is vertical
  std::uint32_t width = 1280, height = 720;  // pixels
  std::uint32_t supersample = 2;             // N x N samples a pixel
  Drawn drawn = Drawn::kCorrected;
  bool remoteShaders = true;  // as FlyOptions
};

// Returns an exit code (exit.h). A terrain that this client does not know is drawn as the mesh in neutral colours. Progress and errors go
// to stderr.
int picture(const PictureOptions& options);

}  // namespace ridgecast::evaluation
