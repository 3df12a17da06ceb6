#pragma once
// A camera as refinement sees it, for one iteration.

#include <algorithm>
#include <array>
#include <cmath>

#include "common/camera/camera.h"
#include "common/triangulation/triangulation.h"
#include "server/refinement/horizon.h"
#include "server/refinement/metric.h"

namespace ridgecast::refinement {

// Of the drawn frustum's tangents: what may be drawn soon.
inline constexpr double kWidening = 1.31;
// Dormant candidates outside the wide frustum wake when the camera has moved this share of the distance to their triangle, or turned this
// far (radians), both in units of the angle by which the wide frustum is wider on each side than the drawn one.
inline constexpr double kWakeMove = 0.58, kWakeTurn = 0.36;
inline constexpr double kHiddenMargin = 2;     // pixels
inline constexpr float kNearest = 0.5f * 256;  // steps: nearer than this nothing is refined further for being near

// Positions are relative to the mesh's anchor.
struct View {
  // `travelled` (steps) and `turned` (radians): how far this camera has moved and turned in its life; they only grow.
  View(const camera::Camera& camera, lattice::Point anchor, double travelled, double turned, bool onTheWay, Metric metric = Metric::kPixels)
      : x(static_cast<std::int32_t>(camera.pose.x - anchor.x)),
        z(static_cast<std::int32_t>(camera.pose.z - anchor.z)),
        y(static_cast<float>(camera.pose.y * lattice::kStepsPerMetre)),
        pixelsPerRadian(camera::pixelsPerRadian(camera.projection)),
        wide(camera.pose, camera.projection, kWidening),
        sector(camera.pose, camera.projection),
        forward(camera::forward(camera.pose)),
        right(camera::right(camera.pose)),
        up(camera::up(camera.pose)),
        tanX(std::tan(camera.projection.verticalFov / 2) * camera.projection.aspect()),
        tanY(std::tan(camera.projection.verticalFov / 2)),
        travel(travelled),
        turn(turned),
        spare(std::min(std::atan(kWidening * tanX) - std::atan(tanX), std::atan(kWidening * tanY) - std::atan(tanY))),
        moving(onTheWay),
        measure(metric),
        gain(measure.gain(pixelsPerRadian)) {}

  std::int32_t x, z;  // steps
  float y;            // steps, absolute
  double pixelsPerRadian;
  camera::Frustum wide;
  camera::Sector sector;  // of what is drawn
  camera::Vec3 forward, right, up;
  double tanX, tanY;  // of the drawn half angles
  double travel, turn;
  double spare;  // radians: the wide frustum is wider by this on each side than the drawn one
  bool moving;   // candidates are then inserted up to kSlack late (bounds.h); at rest, exactly
  Measure measure;
  double gain;         // the measure's
  double closely = 0;  // pixels: points no farther apart are tried in what is drawn (chooser.cpp); 0: the same few in each triangle
  const Horizon* horizon = nullptr;  // not with Metric::kThesis; null: nothing is hidden
  double wakeMove() const { return kWakeMove * spare; }
  double wakeTurn() const { return kWakeTurn * spare; }

  // Whether a point, in metres relative to the camera, lies behind other ground, and by more than kHiddenMargin.
  bool hides(const camera::Vec3& p) const { return horizon && horizon->hidden(p, kHiddenMargin / pixelsPerRadian); }

  // A point in metres relative to the camera.
  camera::Vec3 relative(std::int32_t px, std::int32_t pz, double py) const {
    return {(double(px) - x) * lattice::kMetresPerStep, (py - y) * lattice::kMetresPerStep, (double(pz) - z) * lattice::kMetresPerStep};
  }
};

// A triangle's corners, in metres relative to the camera.
inline std::array<camera::Vec3, 3> cornersOf(const triangulation::Triangulation& mesh, const View& view, triangulation::TriangleId t) {
  std::array<camera::Vec3, 3> corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const triangulation::Vertex& v = mesh.vertex(mesh.triangle(t).v[k]);
    corners[k] = view.relative(v.x, v.z, v.y);
  }
  return corners;
}

}  // namespace ridgecast::refinement
