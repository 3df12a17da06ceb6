#include "client/viewer/controls.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ridgecast::viewer {
namespace {

constexpr double kTurn = 0.0025;    // radians a screen coordinate
constexpr double kLowest = 2;       // metres above ground
constexpr double kHighest = 30000;  // metres, absolute

void advance(lattice::Step& whole, double& remainder, double metres) {
  const double steps = remainder + metres * lattice::kStepsPerMetre, floor = std::floor(steps);
  whole = std::clamp(whole + static_cast<lattice::Step>(floor), -lattice::kMaxPosition, lattice::kMaxPosition);
  remainder = std::min(steps - floor, std::nextafter(1.0, 0.0));
}

constexpr double kRest = 0.15;  // worn sticks do not return to 0
constexpr double kNotches = 6;  // of the speed, a second

void add(double& to, double what) { to = std::clamp(to + what, -1.0, 1.0); }

}  // namespace

void Controls::moveBy(double x, double y, double z) {
  advance(pose_.x, pose_.remainderX, x);
  advance(pose_.z, pose_.remainderZ, z);
  pose_.y = std::min(pose_.y + y, kHighest);
}

void Controls::step(const Input& input, double seconds, const Ground& ground) {
  speed_ = std::clamp(speed_ * std::pow(1.2, input.wheel), kSlowest, kFastest);
  const double down = invertY_ ? -1 : 1;
  pose_.yaw = std::remainder(pose_.yaw - input.turnX * kTurn - input.lookRight * kLook * seconds, 2 * std::numbers::pi);
  pose_.pitch = std::clamp(pose_.pitch + down * (input.lookUp * kLook * seconds - input.turnY * kTurn), -1.55, 1.55);

  camera::Vec3 f = camera::forward(pose_);
  const camera::Vec3 r = camera::right(pose_);
  const double metres = speed() * (input.sprint ? 5 : 1) * seconds;
  if (walking_) f = {-std::sin(pose_.yaw), 0, -std::cos(pose_.yaw)};
  const double up = walking_ ? 0 : input.up;
  if (input.forward != 0 || input.right != 0 || up != 0)
    moveBy((f.x * input.forward + r.x * input.right) * metres, (f.y * input.forward + up) * metres,
           (f.z * input.forward + r.z * input.right) * metres);
  const auto height = ground({pose_.x, pose_.z});
  if (height) pose_.y = walking_ ? *height + kEyes : std::max(pose_.y, *height + kLowest);
}

bool Sprint::update(bool down, bool moves, double now) {
  if (down && !down_) {
    since_ = now;
    latched_ = !latched_;
  } else if (!down && down_ && now - since_ > kTap) {
    latched_ = false;  // it was held, not tapped
  }
  down_ = down;
  if (!down && !moves && now - since_ > kTap) latched_ = false;
  return down || latched_;
}

double stick(float value) {
  const double v = std::isfinite(value) ? std::clamp(static_cast<double>(value), -1.0, 1.0) : 0;
  const double beyond = std::max(0.0, std::abs(v) - kRest) / (1 - kRest);
  return std::copysign(beyond * beyond, v);
}

void addGamepad(Input& input, const GamepadAxes& axes, bool sprint, bool slower, bool faster, double seconds) {
  add(input.right, stick(axes[0]));
  add(input.forward, -stick(axes[1]));
  add(input.lookRight, stick(axes[2]));
  add(input.lookUp, -stick(axes[3]));
  const auto trigger = [](float value) { return stick((value + 1) / 2); };
  add(input.up, trigger(axes[5]) - trigger(axes[4]));
  input.sprint |= sprint;
  input.wheel += kNotches * seconds * (faster - slower);
}

}  // namespace ridgecast::viewer
