#pragma once
// How keys and mouse move the camera. No window system: values in, pose out.

#include <functional>
#include <optional>

#include "common/camera/camera.h"

namespace ridgecast::viewer {

// What is held down or was moved since the last step.
struct Input {
  double forward = 0, right = 0, up = 0;  // -1, 0 or 1
  bool sprint = false;                    // five times as fast
  double turnX = 0, turnY = 0;            // mouse, in screen coordinates, right and down
  double wheel = 0;                       // notches
};

class Controls {
 public:
  explicit Controls(const camera::Pose& start) : pose_(start) {}
  const camera::Pose& pose() const { return pose_; }
  double speed() const { return speed_; }  // metres a second

  // One step of `seconds`; the camera stays at least 2 m above `ground` and within the lattice.
  void step(const Input& input, double seconds, const std::function<std::optional<double>(lattice::Point)>& ground);

 private:
  void moveBy(double x, double y, double z);  // metres
  camera::Pose pose_;
  double speed_ = 50;
};

}  // namespace ridgecast::viewer
