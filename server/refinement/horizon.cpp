#include "server/refinement/horizon.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "common/lattice/lattice.h"

namespace ridgecast::refinement {

namespace {

// Rays are cast anew when the eye has moved this far from where they start: metres, and a share of its height above the ground.
constexpr double kStay = 4, kStayShare = 0.15;
// Nothing is hidden by what lies nearer to it than this share of its distance: the surface does not hide itself.
constexpr double kBefore = 0.98;

// Of samples, metres.
const std::array<double, Horizon::kSamples>& distances() {
  static const auto table = [] {
    std::array<double, Horizon::kSamples> r{};
    for (int k = 0; k < Horizon::kSamples; ++k)
      r[static_cast<std::size_t>(k)] =
          Horizon::kFirst * std::ldexp(1 + static_cast<double>(k % Horizon::kDoubling) / Horizon::kDoubling, k / Horizon::kDoubling);
    return r;
  }();
  return table;
}
// The sample at or before a distance >= 1, in units of kFirst.
std::size_t sampleAt(double distance) {
  const auto bits = std::bit_cast<std::uint64_t>(distance);  // positive: the exponent, and 52 bits of what follows the one
  const std::uint64_t doublings = (bits >> 52) - 1023, rest = (bits & ((std::uint64_t{1} << 52) - 1)) >> 20;
  return std::min<std::size_t>(Horizon::kSamples - 1, doublings * Horizon::kDoubling + ((rest * Horizon::kDoubling) >> 32));
}

constexpr int kQuarter = Horizon::kRays / 4;
static_assert(Horizon::kRays % 4 == 0);

// The direction of a ray, of length 1: from +x by +z.
struct Direction {
  double x, z;
};
Direction directionOf(int ray) {
  const double along = static_cast<double>(ray % kQuarter) / kQuarter, back = 1 - along, length = std::sqrt(along * along + back * back);
  const double u = back / length, w = along / length;
  switch (ray / kQuarter) {
    case 0:
      return {u, w};
    case 1:
      return {-w, u};
    case 2:
      return {-u, -w};
    default:
      return {w, -u};
  }
}
lattice::Point placeOn(const Direction& ray, double distance, const camera::Pose& from) {
  return {from.x + static_cast<lattice::Step>(std::lrint(ray.x * distance * lattice::kStepsPerMetre)),
          from.z + static_cast<lattice::Step>(std::lrint(ray.z * distance * lattice::kStepsPerMetre))};
}
// The ray at or before a direction of any length but none; the next one is beyond it.
std::size_t rayAt(double x, double z) {
  const double share = kQuarter / (std::abs(x) + std::abs(z));
  const double turn = x > 0 ? (z >= 0 ? z * share : 3 * kQuarter + x * share) : (z > 0 ? kQuarter - x * share : 2 * kQuarter - z * share);
  return std::min<std::size_t>(Horizon::kRays - 1, static_cast<std::size_t>(turn));
}

}  // namespace

void Horizon::setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) {
  terrain_ = std::move(terrain);
  isOnOtherGround_ = true;
  for (int ray = 0; ray < kRays; ++ray)
    if (std::ranges::any_of(changed, [&](const lattice::Area& area) { return isOver(ray, area); }))
      known_[static_cast<std::size_t>(ray)] = 0;
}

// Whether any of its samples lies there.
bool Horizon::isOver(int ray, const lattice::Area& area) const {
  const Direction direction = directionOf(ray);
  // The stretch of the ray between the sides of the area, along one axis and then along the other.
  double from = 0, to = distances().back();
  const auto clip = [&](double along, lattice::Step low, lattice::Step high, lattice::Step middle) {
    const double near = (static_cast<double>(low - middle) - 1) * lattice::kMetresPerStep,
                 far = (static_cast<double>(high - middle) + 1) * lattice::kMetresPerStep;
    if (along == 0) {
      if (near > 0 || far < 0) to = -1;
      return;
    }
    from = std::max(from, std::min(near / along, far / along));
    to = std::min(to, std::max(near / along, far / along));
  };
  clip(direction.x, area.x0, area.x1, centre_.x);
  clip(direction.z, area.z0, area.z1, centre_.z);
  return std::ranges::any_of(distances(), [&](double r) { return r >= from && r <= to && area.holds(placeOn(direction, r, centre_)); });
}

const std::vector<int>& Horizon::follow(const camera::Camera& camera, double above, double leave, double widening) {
  const camera::Pose& pose = camera.pose;
  const auto offset = [&] {
    return camera::Vec3{static_cast<double>(pose.x - centre_.x) * lattice::kMetresPerStep, pose.y - centre_.y,
                        static_cast<double>(pose.z - centre_.z) * lattice::kMetresPerStep};
  };
  offset_ = offset();
  const double way = std::sqrt(offset_.x * offset_.x + offset_.y * offset_.y + offset_.z * offset_.z);
  const double stay = leave > 0 && !std::exchange(isOnOtherGround_, false) ? leave * (kStay + kStayShare * std::max(0.0, above)) : 0;
  if (!centred_ || way > stay) {
    centre_ = pose;
    centred_ = true;
    offset_ = {0, 0, 0};
    std::fill(known_.begin(), known_.end(), std::uint8_t{0});
    steepest_.resize(static_cast<std::size_t>(kRays) * kSamples);
  }
  // The directions between the wide frustum's corners; all of them when it looks down steeply.
  wanted_.clear();
  const double tanY = std::tan(camera.projection.verticalFov / 2) * widening, tanX = tanY * camera.projection.aspect();
  const double level = std::cos(std::min(std::abs(pose.pitch) + std::atan(tanY), std::numbers::pi / 2));
  // The least cosine of the angle to the middle: one ray beyond the corners.
  const double least = level < 0.2 ? -2 : std::cos(std::min(std::numbers::pi, std::atan(tanX / level) + 4 / static_cast<double>(kQuarter)));
  camera::Pose straight = pose;
  straight.pitch = 0;
  const camera::Vec3 ahead = camera::forward(straight);
  for (int ray = 0; ray < kRays; ++ray)
    if (const Direction d = directionOf(ray); !known_[static_cast<std::size_t>(ray)] && d.x * ahead.x + d.z * ahead.z >= least)
      wanted_.push_back(ray);
  heights_ += wanted_.size() * kSamples;
  return wanted_;
}

void Horizon::cast(int ray) {
  const Direction direction = directionOf(ray);
  const auto& r = distances();
  std::array<lattice::Step, kSamples> x, z;
  std::array<float, kSamples> y;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const lattice::Point p = placeOn(direction, r[k], centre_);
    x[k] = p.x;
    z[k] = p.z;
  }
  terrain_->heights(x, z, y);
  float* out = &steepest_[static_cast<std::size_t>(ray) * kSamples];
  auto most = -std::numeric_limits<float>::infinity();
  for (std::size_t k = 0; k < kSamples; ++k) {
    const auto slope = static_cast<float>((y[k] - centre_.y) / r[k]);
    if (slope > most) most = slope;
    out[k] = most;
  }
  known_[static_cast<std::size_t>(ray)] = 1;
}

bool Horizon::hidden(const camera::Vec3& p, double margin) const {
  if (!centred_) return false;
  const double dx = p.x + offset_.x, dy = p.y + offset_.y, dz = p.z + offset_.z, flat = std::sqrt(dx * dx + dz * dz);
  if (flat * kBefore < kFirst) return false;
  const std::size_t sample = sampleAt(flat * kBefore / kFirst), ray = rayAt(dx, dz), next = ray + 1 == kRays ? 0 : ray + 1;
  if (!known_[ray] || !known_[next]) return false;
  return dy / flat + margin < std::min(steepest_[ray * kSamples + sample], steepest_[next * kSamples + sample]);
}

}  // namespace ridgecast::refinement
