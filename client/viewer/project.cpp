#include "client/viewer/project.h"

#include <algorithm>
#include <cmath>

namespace ridgecast::viewer {
namespace {

constexpr double kNearest = 0.05;  // metres

double dot(const camera::Vec3& a, const camera::Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

camera::Vec3 mix(const camera::Vec3& a, const camera::Vec3& b, double t) {
  return {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), a.z + t * (b.z - a.z)};
}

}  // namespace

camera::Vec3 between(const camera::Pose& from, const camera::Pose& to) {
  return {(static_cast<double>(to.x - from.x) + to.remainderX - from.remainderX) * lattice::kMetresPerStep, to.y - from.y,
          (static_cast<double>(to.z - from.z) + to.remainderZ - from.remainderZ) * lattice::kMetresPerStep};
}

std::optional<Spot> spotOf(const camera::Camera& camera, const camera::Vec3& at) {
  const double depth = dot(at, camera::forward(camera.pose));
  if (!(depth >= kNearest)) return std::nullopt;
  const double tangent = std::tan(camera.projection.verticalFov / 2);
  return Spot{0.5 + 0.5 * dot(at, camera::right(camera.pose)) / (depth * tangent * camera.projection.aspect()),
              0.5 - 0.5 * dot(at, camera::up(camera.pose)) / (depth * tangent), depth};
}

camera::Vec3 towards(const camera::Camera& camera, double x, double y) {
  const camera::Vec3 f = camera::forward(camera.pose), r = camera::right(camera.pose), u = camera::up(camera.pose);
  const double tangent = std::tan(camera.projection.verticalFov / 2);
  const double right = tangent * camera.projection.aspect() * (2 * x - 1), up = tangent * (1 - 2 * y);
  return {f.x + right * r.x + up * u.x, f.y + right * r.y + up * u.y, f.z + right * r.z + up * u.z};
}

std::optional<Segment> segmentOf(const camera::Camera& camera, const camera::Vec3& a, const camera::Vec3& b) {
  const camera::Vec3 f = camera::forward(camera.pose), r = camera::right(camera.pose), u = camera::up(camera.pose);
  const double tangent = std::tan(camera.projection.verticalFov / 2), wide = tangent * camera.projection.aspect();
  // Not negative inside: distance to the near plane, then to the four sides.
  const auto inside = [&](const camera::Vec3& p, std::size_t plane) {
    const double depth = dot(p, f), x = dot(p, r), y = dot(p, u);
    return std::array{depth - 2 * kNearest, depth * wide - x, depth * wide + x, depth * tangent - y, depth * tangent + y}[plane];
  };
  double from = 0, to = 1;
  for (std::size_t plane = 0; plane < 5; ++plane) {
    const double first = inside(a, plane), second = inside(b, plane);
    if (first < 0 && second < 0) return std::nullopt;
    if (first < 0) from = std::max(from, first / (first - second));
    if (second < 0) to = std::min(to, first / (first - second));
  }
  if (from >= to) return std::nullopt;
  const auto first = spotOf(camera, mix(a, b, from)), second = spotOf(camera, mix(a, b, to));
  if (!first || !second) return std::nullopt;
  return Segment{*first, *second};
}

std::array<std::pair<camera::Vec3, camera::Vec3>, 8> frustumEdges(const camera::Camera& seen, const camera::Pose& from, double reach) {
  const camera::Vec3 apex = between(from, seen.pose), f = camera::forward(seen.pose), r = camera::right(seen.pose),
                     u = camera::up(seen.pose);
  const double tangent = std::tan(seen.projection.verticalFov / 2), wide = tangent * seen.projection.aspect();
  std::array<camera::Vec3, 4> corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const double x = (k == 0 || k == 3 ? -1 : 1) * wide, y = (k < 2 ? 1 : -1) * tangent;
    corners[k] = {apex.x + reach * (f.x + x * r.x + y * u.x), apex.y + reach * (f.y + x * r.y + y * u.y),
                  apex.z + reach * (f.z + x * r.z + y * u.z)};
  }
  std::array<std::pair<camera::Vec3, camera::Vec3>, 8> out;
  for (std::size_t k = 0; k < 4; ++k) {
    out[k] = {apex, corners[k]};
    out[4 + k] = {corners[k], corners[(k + 1) % 4]};
  }
  return out;
}

}  // namespace ridgecast::viewer
