#pragma once
// Moves the camera by keys, mouse and gamepad. No window system: values in, pose out.

#include <array>
#include <functional>
#include <optional>

#include "common/camera/camera.h"

namespace ridgecast::viewer {

// What is held down, and what has moved since the last step.
struct Input {
  double forward = 0, right = 0, up = 0;  // -1 to 1
  bool sprint = false;                    // five times as fast
  double turnX = 0, turnY = 0;            // mouse, in screen coordinates, right and down
  double wheel = 0;                       // notches
  double lookRight = 0, lookUp = 0;       // -1 to 1: keys and sticks, kLook radians a second
  bool moves() const { return forward != 0 || right != 0 || up != 0; }
};

inline constexpr double kLook = 1.2;
inline constexpr double kEyes = 1.7;                    // metres above the ground, walking
inline constexpr double kWalkShare = 0.1;               // of the flying speed
inline constexpr double kSlowest = 1, kFastest = 5000;  // metres a second, flying

class Controls {
 public:
  using Ground = std::function<std::optional<double>(lattice::Point)>;

  explicit Controls(const camera::Pose& start, double speed = 50) : pose_(start), speed_(speed) {}
  const camera::Pose& pose() const { return pose_; }
  double speed() const { return speed_ * (walking_ ? kWalkShare : 1); }  // metres a second
  double flyingSpeed() const { return speed_; }

  // One step of `seconds`. The camera stays at least 2 m above `ground` and within the lattice. Walking, it stays kEyes above known ground,
  // and `up` has no effect.
  void step(const Input& input, double seconds, const Ground& ground);

  void setWalking(bool walking) { walking_ = walking; }
  bool walking() const { return walking_; }
  void setInvertY(bool invert) { invertY_ = invert; }     // of the mouse and the sticks
  void place(const camera::Pose& pose) { pose_ = pose; }  // jumps there

 private:
  void moveBy(double x, double y, double z);  // metres
  camera::Pose pose_;
  double speed_;
  bool walking_ = false, invertY_ = false;
};

// A tap of the key keeps sprinting until the next tap or until the camera rests. Held down, the key sprints while it is held.
class Sprint {
 public:
  // Once a frame; `now` in seconds.
  bool update(bool down, bool moves, double now);

 private:
  static constexpr double kTap = 0.25;  // seconds
  bool down_ = false, latched_ = false;
  double since_ = 0;
};

// As GLFW orders them: left x, left y, right x, right y (down and right are positive), left and right trigger (-1 released, 1 pressed).
using GamepadAxes = std::array<float, 6>;

// A stick's effect at `value`: none near its rest, then growing with the square, so that small turns are small.
double stick(float value);

// Adds a gamepad to the input of keys and mouse: left stick flies, right stick looks, triggers go down and up, shoulders set the speed. The
// sum stays within -1 and 1.
void addGamepad(Input& input, const GamepadAxes& axes, bool sprint, bool slower, bool faster, double seconds);

}  // namespace ridgecast::viewer
