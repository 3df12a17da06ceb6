#pragma once
// What is written over the two pictures: figures, help, messages, the divider. Dear ImGui behind it.

#include <cstdint>
#include <string>

struct GLFWwindow;

namespace ridgecast::viewer {

enum class Mode { kMesh, kMarch, kSplit, kDifference };

struct Shown {
  Mode mode = Mode::kSplit;
  double divider = 0.5;  // share of the window's width
  bool help = false, figures = true, mouseFree = true;
  std::string message;  // empty: none; else in the middle, until it changes

  std::string world;  // terrain, seed, server
  double framesPerSecond = 0, meshMs = 0, marchMs = 0, progress = 1;
  std::uint32_t coarseness = 1;  // pixels a side that one ray of the march stands for
  std::uint64_t triangles = 0, leaves = 0, iteration = 0, bytes = 0;
  double iterationsPerSecond = 0, latencyMs = 0;
  double knownReach = 0;  // metres; of a height map: so far it is known here; 0: all is
  bool smooth = true, recording = false;
  std::size_t keyframes = 0;  // recorded
  bool settled = false, hashOk = true;
  double x = 0, z = 0, y = 0, aboveGround = 0, speed = 0;
};

class Overlay {
 public:
  explicit Overlay(GLFWwindow* window);  // the context must be current
  ~Overlay();
  Overlay(const Overlay&) = delete;
  Overlay& operator=(const Overlay&) = delete;
  void draw(const Shown& shown);  // into the window's framebuffer
};

}  // namespace ridgecast::viewer
