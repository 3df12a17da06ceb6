#pragma once
// A camera path: keyframes in time, read from a JSON file
//   {"terrain": "alpine", "seed": 1, "keyframes": [{"t": 0, "x": 0, "z": 0, "altitude": 120, "yaw": 0, "pitch": -10}, ...]}
// Seconds, metres, degrees. A keyframe has `altitude` (above the ground there) or `y` (absolute). Optional "fov" (vertical, degrees,
// default 60). Positions are interpolated by a centripetal-free, plain Catmull-Rom curve in coordinates relative to the first
// keyframe (so that 1e12 m out is as smooth as the origin), yaw linearly the shortest way, pitch linearly.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "common/camera/camera.h"
#include "common/outcome/outcome.h"

namespace ridgecast::camera {

struct Keyframe {
  double t = 0;                      // seconds, strictly ascending, the first is 0
  lattice::Step x = 0, z = 0;        // steps
  double height = 0;                 // metres: above the ground when `aboveGround`, else absolute
  bool aboveGround = true;
  double yaw = 0, pitch = 0;         // radians
};

struct Path {
  std::string terrain;               // empty: not stated
  std::uint32_t seed = 1;
  double verticalFov = 1.0471975511965976;
  std::vector<Keyframe> keyframes;   // at least one
  double duration() const { return keyframes.back().t; }
};

// Height of the ground in metres at a point, for keyframes above ground.
using GroundHeight = std::function<double(lattice::Point)>;

// Limits: 1 MiB of text, 10,000 keyframes, |x|, |z| <= 4.3e12 m, 24 h. Errors name the keyframe and field and what would be right.
Outcome<Path> parsePath(std::string_view json);
Outcome<Path> readPath(const std::filesystem::path& file);

// The pose at time t (clamped to the path). The camera's own altitude above ground is interpolated when both neighbours state one.
Pose poseAt(const Path& path, double t, const GroundHeight& ground);

}  // namespace ridgecast::camera
