#include "server/refinement/horizon.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/lattice/lattice.h"

namespace ridgecast::refinement {

namespace {

// Rays are cast anew when the eye has moved this far from where they start: metres, and a share of its height above the ground.
constexpr double kStay = 4, kStayShare = 0.15;
// Nothing is hidden by what lies nearer to it than this share of its distance: the surface does not hide itself.
constexpr double kBefore = 0.98;

const std::array<double, Horizon::kSamples>& distances() {
  static const auto table = [] {
    std::array<double, Horizon::kSamples> r{};
    double next = Horizon::kFirst;
    for (double& d : r) d = next, next *= Horizon::kGrowth;
    return r;
  }();
  return table;
}

double angleOf(int ray) { return ray * (2 * std::numbers::pi / Horizon::kRays); }

}  // namespace

const std::vector<int>& Horizon::follow(const camera::Camera& camera, double above, double widening) {
  const camera::Pose& pose = camera.pose;
  const auto offset = [&] {
    return camera::Vec3{static_cast<double>(pose.x - centre_.x) * lattice::kMetresPerStep, pose.y - centre_.y,
                        static_cast<double>(pose.z - centre_.z) * lattice::kMetresPerStep};
  };
  offset_ = offset();
  const double way = std::sqrt(offset_.x * offset_.x + offset_.y * offset_.y + offset_.z * offset_.z);
  if (!centred_ || way > kStay + kStayShare * std::max(0.0, above)) {
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
  const double half = level < 0.2 ? std::numbers::pi : std::atan(tanX / level) + 2 * std::numbers::pi / kRays;
  camera::Pose straight = pose;
  straight.pitch = 0;
  const camera::Vec3 ahead = camera::forward(straight);
  const double middle = std::atan2(ahead.z, ahead.x);
  for (int ray = 0; ray < kRays; ++ray)
    if (!known_[static_cast<std::size_t>(ray)] && std::abs(std::remainder(angleOf(ray) - middle, 2 * std::numbers::pi)) <= half)
      wanted_.push_back(ray);
  heights_ += wanted_.size() * kSamples;
  return wanted_;
}

void Horizon::cast(int ray) {
  const double cosine = std::cos(angleOf(ray)) * lattice::kStepsPerMetre, sine = std::sin(angleOf(ray)) * lattice::kStepsPerMetre;
  std::array<lattice::Step, kSamples> x, z;
  std::array<float, kSamples> y;
  const auto& r = distances();
  for (std::size_t k = 0; k < kSamples; ++k) {
    x[k] = centre_.x + static_cast<lattice::Step>(std::llround(cosine * r[k]));
    z[k] = centre_.z + static_cast<lattice::Step>(std::llround(sine * r[k]));
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
  const auto sample =
      std::min<std::size_t>(kSamples - 1, static_cast<std::size_t>(std::log(flat * kBefore / kFirst) * (1 / std::log(kGrowth))));
  double turn = std::atan2(dz, dx) * (kRays / (2 * std::numbers::pi));
  if (turn < 0) turn += kRays;
  const auto ray = static_cast<std::size_t>(turn) % kRays, next = (ray + 1) % kRays;
  if (!known_[ray] || !known_[next]) return false;
  return dy / flat + margin < std::min(steepest_[ray * kSamples + sample], steepest_[next * kSamples + sample]);
}

}  // namespace ridgecast::refinement
