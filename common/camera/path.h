#pragma once
// A camera path: keyframes in time, read from a JSON file
//   {"terrain": "alpine", "seed": 1, "keyframes": [{"t": 0, "x": 0, "z": 0, "altitude": 120, "yaw": 0, "pitch": -10}, ...]}
// Seconds, metres, degrees. A keyframe has t, x, z, yaw, pitch and either `altitude` (above the ground there) or `y` (absolute).
// Optional beside the keyframes: "terrain", "seed", "fov" (vertical, degrees, default 60), and "name" and "comment", which are ignored.
//
// Between keyframes x and z follow a Catmull-Rom curve over time (a cubic through both ends whose slope at a keyframe is that of the line
// between its neighbours), in coordinates relative to the segment's first keyframe, so that 1e12 m out is as smooth as the origin.
// Heights do the same with slopes limited so that they never leave the range of both ends (Fritsch and Carlson 1980): a camera that comes
// down to 2 m does not dive below the ground. Yaw turns linearly the shortest way, pitch linearly.

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
  double t = 0;                // seconds, ascending by at least 1 ms, the first is 0
  lattice::Step x = 0, z = 0;  // steps
  double height = 0;           // metres: above the ground when `aboveGround`, else absolute
  bool aboveGround = true;
  double yaw = 0, pitch = 0;  // radians
};

struct Path {
  std::string terrain;  // empty: not stated
  std::uint32_t seed = 1;
  double verticalFov = 1.0471975511965976;
  std::vector<Keyframe> keyframes;  // at least one
  double duration() const { return keyframes.back().t; }
};

// Height of the ground in metres at a point, for keyframes above ground.
using GroundHeight = std::function<double(lattice::Point)>;

// Limits: 1 MiB of text, 10,000 keyframes, |x|, |z| <= 4.3e12 m, 24 h. Errors name the keyframe (the first is number 1) and field and say
// what would be right. Fields that are not known are errors too, so that a misspelt one is not silently ignored.
Outcome<Path> parsePath(std::string_view json);
Outcome<Path> readPath(const std::filesystem::path& file);

// The pose at time t (clamped to the path). Between two keyframes that state an altitude the altitude is interpolated, and the ground is
// added where the camera is; between others absolute heights are interpolated. `ground` may be empty when no keyframe is above ground.
Pose poseAt(const Path& path, double t, const GroundHeight& ground);

}  // namespace ridgecast::camera
