#pragma once
// A camera path: keyframes in time, read from a JSON file
//   {"terrain": "alpine", "seed": 1, "keyframes": [{"t": 0, "x": 0, "z": 0, "altitude": 120, "yaw": 0, "pitch": -10}, ...]}
// Seconds, metres, degrees. A keyframe has t, x, z, yaw, pitch and either `altitude` (above the ground there) or `y` (absolute). Optional
// at the top level: "terrain", "seed", "fov" (vertical, degrees, default 60), and "name" and "comment", which are ignored.
//
// Between keyframes, x and z follow a Catmull-Rom curve over time: a cubic through both ends whose slope at a keyframe is that of the line
// between its neighbours. Coordinates are relative to the segment's first keyframe, so it is as smooth at 1e12 m as at the origin. Heights
// follow the same curve with limited slopes, so they never leave the range of both ends (Fritsch and Carlson 1980): a camera that descends
// to 2 m does not dive below the ground. Yaw turns linearly the shortest way, pitch linearly.

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
  double height = 0;           // metres: above the ground if `aboveGround`, otherwise absolute
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

// Limits: 1 MiB of text, 10,000 keyframes, |x|, |z| <= 4.3e12 m, 24 h. Errors name the keyframe (from 1) and the field and say what would
// be right. Unknown fields are errors, so that a misspelt one is not silently ignored.
Outcome<Path> parsePath(std::string_view json);
Outcome<Path> readPath(const std::filesystem::path& file);

// The pose at time t (clamped to the path). Between two keyframes with an altitude, the altitude is interpolated and added to the ground at
// the camera. Between others, absolute heights are interpolated. `ground` may be empty if no keyframe is above ground.
Pose poseAt(const Path& path, double t, const GroundHeight& ground);

}  // namespace ridgecast::camera
