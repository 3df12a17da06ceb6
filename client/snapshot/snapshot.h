#pragma once
// `ridgecast-client snapshot`: a glTF file of a pose, a live camera or a box, made by the server.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "client/connection/connection.h"

namespace ridgecast::snapshot {

struct SnapshotOptions {
  connection::Url url;
  std::filesystem::path out;
  std::optional<std::uint64_t> camera;                                  // a live one; otherwise...
  std::optional<std::array<double, 4>> box;                             // x0, z0, x1, z1 in metres; otherwise the pose
  double error = 1;                                                     // metres, of a box
  double x = 0, z = 0, altitude = 120, yaw = 0, pitch = -10, fov = 60;  // metres, degrees
  std::uint32_t width = 1280, height = 720;                             // pixels
  double threshold = 0.6;                                               // pixels
  double colourError = 0;                                               // as of settings::Settings
  bool draco = false, normals = true, colours = true, metadata = false;
  double timeout = 120;  // seconds
};

// Path and query of the request.
std::string target(const SnapshotOptions& options);

// Reports progress on stderr and what was written on stdout. Exit code: 0 done, 1 failed, with one sentence on stderr.
int snapshot(const SnapshotOptions& options);

}  // namespace ridgecast::snapshot
