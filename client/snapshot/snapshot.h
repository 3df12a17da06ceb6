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
  std::optional<std::uint64_t> camera;                                  // a live one; else...
  std::optional<std::array<double, 4>> box;                             // x0, z0, x1, z1 in metres; else the pose
  double error = 1;                                                     // metres, of a box
  double x = 0, z = 0, altitude = 120, yaw = 0, pitch = -10, fov = 60;  // metres, degrees
  std::uint32_t width = 1280, height = 720;                             // pixels
  double threshold = 0.6;                                               // pixels
  bool draco = false, normals = true, colours = true, metadata = false;
  double patience = 120;  // seconds
};

// Path and query of the request.
std::string target(const SnapshotOptions& options);

// Tells on stderr how it goes, and what was written on stdout. Exit code: 0 done, 1 it failed on the way; its sentence is on stderr.
int snapshot(const SnapshotOptions& options);

}  // namespace ridgecast::snapshot
