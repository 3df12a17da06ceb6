#pragma once
// Which candidates are worth a vertex for this camera. A straight pass over a region's arrays.
//
// kPixels  the distance on screen, in pixels, between the candidate on the mesh and on the terrain, measured where the camera looks
//          straight at it: error x cos(elevation) x pixels per radian / distance. It does not depend on where the camera turns, so
//          turning makes no thrash. At or above the threshold the candidate is wanted.
// kThesis  (area in normalised device coordinates)^0.5 x 40 x (distance in normalised device coordinates), Cavallin and Pettersson
//          2019, algorithm 6, with the constants of their published program; skipped where no corner projects inside the wide frustum.
// Both skip what lies outside the wide frustum.
//
// In pixels a page of 64 candidates is looked at only when it may matter. Moving by m changes a distance d by at most m, so no candidate
// of a page can reach the threshold while
//     pixelsPerRadian * steepest * nearest / (nearest - m) < threshold,
// with steepest the largest error / distance and nearest the smallest distance seen last time; m is bounded by the way the camera has
// travelled since. Candidates that are wanted but not worth a vertex (outside the wide frustum, or their triangle a speck on screen) fall
// asleep, and wake when the camera has moved or turned far enough for that to change; the wide frustum has that much to spare.

#include <cstdint>
#include <vector>

#include "common/camera/camera.h"
#include "server/refinement/candidates.h"

namespace ridgecast::refinement {

inline constexpr double kWidening = 1.35;         // of the drawn frustum's tangents
inline constexpr double kSlack = 1.1;
inline constexpr float kNearest = 0.5f * 256;     // steps: nearer than this nothing is refined further for being near
inline constexpr double kThesisArea = 0.5, kThesisDistance = 40;

// A camera as refinement sees it; positions relative to the mesh's anchor.
struct View {
  // `travel` (steps) and `turn` (radians): how far this camera has moved and turned in its life; they only grow.
  View(const camera::Camera& camera, lattice::Point anchor, double travel, double turn, bool moving);

  std::int32_t x, z;                // steps
  float y;                          // steps, absolute
  double pixelsPerRadian;
  camera::Frustum wide;
  camera::Vec3 forward, right, up;
  double tanX, tanY;                // of the drawn half angles
  double travel, turn;
  bool moving;                      // a page is then looked at only when the threshold may be passed by kSlack; at rest, exactly

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

// Appends the region's candidates at or above the threshold, sorted.
void screenPixels(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view, double threshold,
                  std::vector<Pending>& out);
void screenThesis(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                  double threshold, std::vector<Pending>& out);

}  // namespace ridgecast::refinement
