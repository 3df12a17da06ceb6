#pragma once
// Which candidates are worth a vertex for this camera. A straight pass over a region's arrays.
//
// kPixels  the distance on screen, in pixels, between the candidate on the mesh and on the terrain, measured where the camera looks
//          straight at it: error x cos(elevation) x pixels per radian / distance. It does not depend on where the camera turns, so
//          turning makes no thrash. At or above the threshold the candidate is wanted.
// kThesis  (area in normalised device coordinates)^0.5 x 40 x (distance in normalised device coordinates), Cavallin and Pettersson
//          2019, algorithm 6, with the constants of their published program; skipped where no corner projects inside the wide frustum.
// Both skip what lies outside the wide frustum.

#include <cstdint>
#include <vector>

#include "common/camera/camera.h"
#include "server/refinement/candidates.h"

namespace ridgecast::refinement {

inline constexpr double kWidening = 1.35;         // of the drawn frustum's tangents
inline constexpr double kThesisArea = 0.5, kThesisDistance = 40;

// A camera as refinement sees it; positions relative to the mesh's anchor.
struct View {
  View(const camera::Camera& camera, lattice::Point anchor);

  std::int32_t x, z;                // steps
  float y;                          // steps, absolute
  double pixelsPerRadian;
  camera::Frustum wide;
  camera::Vec3 forward, right, up;
  double tanX, tanY;                // of the drawn half angles

  // A point in metres relative to the camera.
  camera::Vec3 relative(std::int32_t px, std::int32_t pz, double py) const {
    return {(double(px) - x) * lattice::kMetresPerStep, (py - y) * lattice::kMetresPerStep, (double(pz) - z) * lattice::kMetresPerStep};
  }
};

struct Pending {
  triangulation::TriangleId triangle;
  triangulation::Point2 point;
  float priority;                   // the greater the earlier

  // A total order that depends on values only.
  friend bool operator<(const Pending& a, const Pending& b) {
    if (a.priority != b.priority) return a.priority > b.priority;
    return triangulation::smaller(a.point, b.point);
  }
};

// What a screening found about everything it did not append, so that the next ones can be spared while the camera stays near.
// Moving by m changes a distance d by at most m, so nothing can reach the threshold while
//     pixelsPerRadian * steepest * nearest / (nearest - m) < threshold.
struct ScreenBound {
  float steepest = 0;               // largest error / distance
  float nearest = 0;                // steps: smallest distance of any candidate
};

// Appends the region's candidates at or above the threshold, sorted.
ScreenBound screenPixels(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                         double threshold, std::vector<Pending>& out);
void screenThesis(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                  double threshold, std::vector<Pending>& out);

}  // namespace ridgecast::refinement
