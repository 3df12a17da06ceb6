#include "client/core/hands/brush.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "client/core/mesh/mesh_ground.h"
#include "common/outcome/contract.h"

namespace ridgecast::core {
namespace {

constexpr int kAround = 96;
constexpr double kApart = 4 * lattice::kStepsPerMetre, kMaxOfPiece = 256;

lattice::Step along(lattice::Step from, double by) { return from + std::llround(by); }

}  // namespace

std::optional<lattice::Vertex> touched(const Scene& scene, const ground::Ray& ray) {
  const auto hit = cast(scene, ray);
  if (!hit) return std::nullopt;
  const double steps = hit->distance * lattice::kStepsPerMetre / std::hypot(ray.directionX, ray.directionY, ray.directionZ);
  return lattice::Vertex{along(ray.x, ray.directionX * steps), along(ray.z, ray.directionZ * steps),
                         static_cast<std::int32_t>(std::llround(ray.y * lattice::kStepsPerMetre + ray.directionY * steps))};
}

Outline outlineOf(const Scene& scene, const lattice::Vertex& middle, lattice::Step radius, const std::vector<lattice::Vertex>& corners) {
  const auto lay = [&](double x, double z) {
    const lattice::Point p{along(middle.x, x), along(middle.z, z)};
    return Spot{p, scene.height(p).value_or(lattice::metres(middle.y))};
  };
  expects(radius > 0, "a brush has a radius");
  Outline out;
  for (int k = 0; k < kAround; ++k) {
    const double angle = 2 * std::numbers::pi * k / kAround, r = static_cast<double>(radius);
    out.around.push_back(lay(r * std::cos(angle), r * std::sin(angle)));
  }
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const lattice::Vertex &from = corners[k], &to = k + 1 < corners.size() ? corners[k + 1] : middle;
    const double x = static_cast<double>(from.x - middle.x), z = static_cast<double>(from.z - middle.z);
    const double dx = static_cast<double>(to.x - from.x), dz = static_cast<double>(to.z - from.z);
    const double pieces = std::clamp(std::ceil(std::hypot(dx, dz) / kApart), 1.0, kMaxOfPiece);
    for (double p = 0; p < pieces; ++p) out.line.push_back(lay(x + dx * p / pieces, z + dz * p / pieces));
  }
  if (!corners.empty()) out.line.push_back({{middle.x, middle.z}, lattice::metres(middle.y)});
  return out;
}

}  // namespace ridgecast::core
