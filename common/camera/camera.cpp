#include "common/camera/camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/outcome/contract.h"

namespace ridgecast::camera {
namespace {

Vec3 combine(double a, const Vec3& u, double b, const Vec3& v) { return {a * u.x + b * v.x, a * u.y + b * v.y, a * u.z + b * v.z}; }
double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

constexpr const char* kFieldOfView = "a field of view is narrower than a half circle";
bool isFieldOfView(double radians) { return radians > 0 && radians < std::numbers::pi; }

}  // namespace

bool isValid(const Camera& camera) {
  const Pose& p = camera.pose;
  const Projection& q = camera.projection;
  return lattice::positionIsValid(p.x, p.z) && std::isfinite(p.y) && std::abs(p.y) <= 1e6 && std::isfinite(p.yaw) &&
         std::abs(p.yaw) <= 1e6 && std::abs(p.pitch) <= std::numbers::pi / 2 + 1e-9 && q.verticalFov >= 0.01 && q.verticalFov <= 3.0 &&
         q.width >= 1 && q.height >= 1 && q.width <= 32768 && q.height <= 32768;
}

Vec3 forward(const Pose& p) { return {-std::sin(p.yaw) * std::cos(p.pitch), std::sin(p.pitch), -std::cos(p.yaw) * std::cos(p.pitch)}; }
Vec3 right(const Pose& p) { return {std::cos(p.yaw), 0, -std::sin(p.yaw)}; }
Vec3 up(const Pose& p) { return {std::sin(p.yaw) * std::sin(p.pitch), std::cos(p.pitch), std::cos(p.yaw) * std::sin(p.pitch)}; }

double pixelsPerRadian(const Projection& q) {
  expects(isFieldOfView(q.verticalFov), kFieldOfView);
  return q.height / (2.0 * std::tan(q.verticalFov / 2));
}

Frustum::Frustum(const Pose& pose, const Projection& projection, double widening) {
  expects(isFieldOfView(projection.verticalFov), kFieldOfView);
  const Vec3 f = forward(pose), r = right(pose), u = up(pose);
  const double ty = std::tan(projection.verticalFov / 2) * widening, tx = ty * projection.aspect();
  // A point at depth d and lateral offset s is inside when |s| <= d t: the inward normal is t * forward -+ side.
  inward_ = {combine(tx, f, 1, r), combine(tx, f, -1, r), combine(ty, f, 1, u), combine(ty, f, -1, u), f};
}

bool Frustum::mayIntersect(const Vec3& low, const Vec3& high) const {
  for (const Vec3& n : inward_) {
    const Vec3 farthest{n.x > 0 ? high.x : low.x, n.y > 0 ? high.y : low.y, n.z > 0 ? high.z : low.z};
    if (dot(n, farthest) < 0) return false;
  }
  return true;
}

// Clips the triangle by one plane after another (Sutherland and Hodgman 1974), each moved outwards by the reach of the lift.
bool Frustum::meets(const std::array<Vec3, 3>& triangle, double lift) const {
  std::array<Vec3, 3 + 5> corners, kept;
  std::copy(triangle.begin(), triangle.end(), corners.begin());
  std::size_t count = triangle.size();
  for (const Vec3& n : inward_) {
    const double reach = lift * std::abs(n.y);
    std::size_t left = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const Vec3 &a = corners[k], &b = corners[k + 1 == count ? 0 : k + 1];
      const double da = dot(n, a) + reach, db = dot(n, b) + reach;
      if (da >= 0) kept[left++] = a;
      if ((da < 0) != (db < 0)) kept[left++] = combine(1, a, da / (da - db), {b.x - a.x, b.y - a.y, b.z - a.z});
    }
    if (left == 0) return false;
    corners = kept;
    count = left;
  }
  return true;
}

Sector::Sector(const Pose& pose, const Projection& projection) {
  expects(isFieldOfView(projection.verticalFov), kFieldOfView);
  // The picture's corners are farthest from its middle. Of the upper and the lower pair, take the one nearer to the vertical.
  const double tanY = std::tan(projection.verticalFov / 2), tanX = tanY * projection.aspect();
  const double steepest = std::abs(pose.pitch) + projection.verticalFov / 2,
               ahead = std::cos(pose.pitch) - tanY * std::sin(std::abs(pose.pitch));
  all_ = steepest >= std::numbers::pi / 2 || ahead <= 0;
  Pose level = pose;
  level.pitch = 0;
  const Vec3 f = forward(level), r = right(level);
  left_ = combine(tanX, f, ahead, r);
  right_ = combine(tanX, f, -ahead, r);
}

bool Sector::misses(std::span<const Vec3> corners) const {
  const auto beyond = [&](const Vec3& side) {
    return std::all_of(corners.begin(), corners.end(), [&](const Vec3& c) { return dot(side, c) < 0; });
  };
  return !all_ && (beyond(left_) || beyond(right_));
}

bool Frustum::contains(const Vec3& point) const {
  for (const Vec3& n : inward_)
    if (dot(n, point) < 0) return false;
  return true;
}

}  // namespace ridgecast::camera
