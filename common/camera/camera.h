#pragma once
// Pose, projection and frustum of a camera.
//
// Horizontal position in whole steps (plus a remainder for smooth drawing), height in metres, angles in radians; axes and signs as in
// common/lattice. Results are relative to the camera's position, so they are as exact 10^12 m out as at the origin.

#include <array>
#include <cstdint>
#include <span>

#include "common/lattice/lattice.h"

namespace ridgecast::camera {

struct Vec3 {
  double x = 0, y = 0, z = 0;
};

struct Pose {
  lattice::Step x = 0, z = 0;             // steps; |.| <= lattice::kMaxPosition
  double remainderX = 0, remainderZ = 0;  // steps, [0, 1): for drawing only, never sent
  double y = 0;                           // metres, absolute
  double yaw = 0;                         // radians, any value
  double pitch = 0;                       // radians, [-pi/2, pi/2]
  friend bool operator==(const Pose&, const Pose&) = default;
};

struct Projection {
  double verticalFov = 1.0471975511965976;   // radians, (0, pi): 60 degrees
  std::uint32_t width = 1280, height = 720;  // pixels of the picture that is drawn, >= 1
  double aspect() const { return static_cast<double>(width) / height; }
  friend bool operator==(const Projection&, const Projection&) = default;
};

struct Camera {
  Pose pose;
  Projection projection;
  friend bool operator==(const Camera&, const Camera&) = default;
};

// Whether every field is finite and in range. Untrusted poses must pass this check first.
bool isValid(const Camera& camera);

// Unit vectors of the camera in world axes.
Vec3 forward(const Pose& pose);  // (-sin yaw cos pitch, sin pitch, -cos yaw cos pitch)
Vec3 right(const Pose& pose);    // (cos yaw, 0, -sin yaw)
Vec3 up(const Pose& pose);       // right x forward

// Pixels covered by one metre, perpendicular to the view axis, at a depth of one metre: height / (2 tan(fov / 2)).
double pixelsPerRadian(const Projection& projection);

// The four side planes of the view pyramid, apex at the camera; no near or far plane. `widening` multiplies the tangents of both half
// angles, so that ground is refined before it comes into view. At the widest, the pyramid is a half space.
class Frustum {
 public:
  Frustum(const Pose& pose, const Projection& projection, double widening = 1.0);
  // Whether an axis-aligned box, in metres relative to the camera, may intersect. Conservative: never false for a box that does.
  bool mayIntersect(const Vec3& low, const Vec3& high) const;
  bool contains(const Vec3& point) const;
  // Whether a triangle, or any point at most `lift` metres straight above or below it, intersects. Exact except at the corners of the
  // lifted shape.
  bool meets(const std::array<Vec3, 3>& triangle, double lift) const;

 private:
  std::array<Vec3, 5> inward_;  // inward normals: four sides, and the view axis
};

// The compass directions in which a picture sees anything, at any height. All of them if the camera looks steeply up or down.
class Sector {
 public:
  Sector(const Pose& pose, const Projection& projection);
  // Whether the whole convex shape with these corners, in metres relative to the camera, lies outside. False if unsure.
  bool misses(std::span<const Vec3> corners) const;

 private:
  bool all_;
  Vec3 left_, right_;  // inward normals of its sides, horizontal
};

}  // namespace ridgecast::camera
