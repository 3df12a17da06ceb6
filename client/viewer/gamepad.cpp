#include "client/viewer/gamepad.h"

#include <algorithm>
#include <cmath>

namespace ridgecast::viewer {
namespace {

constexpr double kRest = 0.15;  // worn sticks do not return to 0
constexpr double kNotches = 6;  // of the speed, a second

void add(double& to, double what) { to = std::clamp(to + what, -1.0, 1.0); }

}  // namespace

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
