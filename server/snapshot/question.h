#pragma once
// What a snapshot can be asked: a live camera, a pose, or a box at an error. From the parameters of a URL to values within limits, or one
// sentence that says which limit was broken and what would fit. Metres and degrees outside, steps and radians inside. Pure functions.
//
//   camera=ID                                                exactly the mesh that this camera's client holds
//   x z altitude yaw pitch [fov width height threshold]      refined until it settles; y instead of altitude: absolute height
//   x0 z0 x1 z1 error                                        covered exactly, at most `error` metres off vertically
//   compression=draco|none, normals=0|1, colours=0|1         with all of them; none, 1 and 1 unless said
// Every other parameter is an error, so that a misspelt one is not silently ignored.

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>

#include "common/camera/camera.h"
#include "common/gltf/glb.h"
#include "common/outcome/outcome.h"
#include "server/box/box_mesh.h"

namespace ridgecast::snapshot {

struct Limits {
  std::uint32_t triangles = 2'000'000;
  double seconds = 60;
  int niceness = 15;         // of the threads that make them, as scheduling::setNiceness; 20 may never end beside other programs
  double boxSide = 32'768;   // metres, the longest
  double leastError = 0.02;  // metres, of a box
  double mostError = 1'000;
  double leastThreshold = 0.05, mostThreshold = 1'000;  // pixels
};

struct OfCamera {
  std::uint64_t id = 0;
};
struct OfPose {
  camera::Camera camera;  // pose.y is the altitude above the ground while aboveGround
  bool aboveGround = true;
  double threshold = 0.6;  // pixels
};
using OfBox = box::Box;

struct Question {
  std::variant<OfCamera, OfPose, OfBox> of;
  gltf::Compression compression = gltf::Compression::kNone;
  bool normals = true, colours = true;
};

// `query` is what follows the ? of a URL, still percent-encoded.
Outcome<Question> parse(std::string_view query, const Limits& limits);

// The same question always gives the same text, however it was spelt. For an ETag.
std::string canonical(const Question& question);

}  // namespace ridgecast::snapshot
