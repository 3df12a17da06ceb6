#include "client/viewer/controls.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ridgecast::viewer {
namespace {

constexpr double kTurn = 0.0025;    // radians a screen coordinate
constexpr double kLowest = 2;       // metres above ground
constexpr double kHighest = 30000;  // metres, absolute
constexpr double kSlowest = 1, kFastest = 5000;

void advance(lattice::Step& whole, double& remainder, double metres) {
  const double steps = remainder + metres * lattice::kStepsPerMetre, floor = std::floor(steps);
  whole = std::clamp(whole + static_cast<lattice::Step>(floor), -lattice::kMaxPosition, lattice::kMaxPosition);
  remainder = std::min(steps - floor, std::nextafter(1.0, 0.0));
}

}  // namespace

void Controls::moveBy(double x, double y, double z) {
  advance(pose_.x, pose_.remainderX, x);
  advance(pose_.z, pose_.remainderZ, z);
  pose_.y = std::min(pose_.y + y, kHighest);
}

void Controls::step(const Input& input, double seconds, const std::function<std::optional<double>(lattice::Point)>& ground) {
  speed_ = std::clamp(speed_ * std::pow(1.2, input.wheel), kSlowest, kFastest);
  pose_.yaw = std::remainder(pose_.yaw - input.turnX * kTurn, 2 * std::numbers::pi);
  pose_.pitch = std::clamp(pose_.pitch - input.turnY * kTurn, -1.55, 1.55);

  const camera::Vec3 f = camera::forward(pose_), r = camera::right(pose_);
  const double metres = speed_ * (input.sprint ? 5 : 1) * seconds;
  if (input.forward != 0 || input.right != 0 || input.up != 0)
    moveBy((f.x * input.forward + r.x * input.right) * metres, (f.y * input.forward + input.up) * metres,
           (f.z * input.forward + r.z * input.right) * metres);
  if (const auto height = ground({pose_.x, pose_.z})) pose_.y = std::max(pose_.y, *height + kLowest);
}

}  // namespace ridgecast::viewer
