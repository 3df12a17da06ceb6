#pragma once
// Which candidates are worth a vertex for this camera. A straight pass over a region's arrays.
//
// kPixels  the distance on screen, in pixels, between the candidate on the mesh and on the terrain, measured where the camera looks
//          straight at it: error x cos(elevation) x pixels per radian / distance. It does not depend on where the camera turns, so
//          turning makes no thrash. At or above the threshold the candidate is wanted.
// kArea    the same times the fourth root of the triangle's area in square pixels, seen face on at the candidate's distance: an error that
//          covers more of the picture counts for more. The least triangles for a picture; no promise about any one pixel.
// kThesis  (area in normalised device coordinates)^0.5 x 40 x (distance in normalised device coordinates), Cavallin and Pettersson
//          2019, algorithm 6, with the constants of their published program. A triangle that reaches behind the camera counts as large as
//          the picture.
// All skip what is not seen: where neither the triangle nor the ground over it, as far from it as its candidate is, meets the wide frustum. (To ask
// where the candidate lies is not enough: a triangle under the camera may have its candidate behind the camera and still fill the picture.)
//
// But for the thesis's metric a page of 64 candidates is looked at only when it may matter. Moving by m changes a distance d and a horizontal distance f by at
// most m, so no candidate of a page can reach the threshold while either
//     error / (d - m)^p <= steepest (nearest / (nearest - m))^p                           or
//     error (f + m) / (d - m)^(p + 1) <= (seen + steepest m / nearest) (nearest / (nearest - m))^(p + 1)
// times the view's gain is below it (kPixels: p = 1; kArea: p = 3/2, with the area's fourth root in the error), with the largest values seen last time; m is bounded by the way the camera has
// travelled since. That gives the way after which the page is *due*, and the region is due with the earliest of its pages. New candidates
// are folded into their page's bounds when they are made. Candidates that are wanted but not worth a vertex (their triangle is not seen, hidden whole behind other ground,
// or a speck on the screen) fall asleep, and wake when the camera has moved or turned far enough for that to change; the wide frustum has that much to
// spare. When the camera rests, those that fell asleep on the way are judged again, so that what is said of a mesh at rest is exact.
//
// A wanted candidate is told once: who does not insert it says so by Surface::wakeCandidate.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/camera/camera.h"
#include "server/refinement/horizon.h"
#include "server/refinement/surface.h"

namespace ridgecast::refinement {

inline constexpr double kWidening = 1.31;  // of the drawn frustum's tangents: what may be drawn soon, at as much work as 1.35 took while a triangle outside counted for nothing
inline constexpr double kSlack = 1.1;
inline constexpr float kNearest = 0.5f * 256;  // steps: nearer than this nothing is refined further for being near
// Candidates outside the wide frustum wake when the camera has moved this share of the distance to their triangle, or turned this far (radians), in units
// of the angle by which the wide frustum is wider on each side than the one that is drawn; those that are hidden or specks after another share.
inline constexpr double kWakeMove = 0.58, kWakeTurn = 0.36, kWakeHidden = 0.15;
inline constexpr double kHiddenMargin = 2;  // pixels
inline constexpr double kThesisArea = 0.5, kThesisDistance = 40;

// A camera as refinement sees it; positions relative to the mesh's anchor.
struct View {
  // `travel` (steps) and `turn` (radians): how far this camera has moved and turned in its life; they only grow.
  View(const camera::Camera& camera, lattice::Point anchor, double travel, double turn, bool moving, bool area = false);

  std::int32_t x, z;  // steps
  float y;            // steps, absolute
  double pixelsPerRadian;
  camera::Frustum wide;
  camera::Sector sector;  // of what is drawn
  camera::Vec3 forward, right, up;
  double tanX, tanY;  // of the drawn half angles
  double travel, turn;
  double spare;  // radians: the wide frustum is wider by this on each side than the drawn one
  bool moving;  // a page is then looked at only when the threshold may be passed by kSlack; at rest, exactly
  bool area;    // kArea
  double gain;  // what is seen of an error in steps at a distance in steps is gain x error x horizontal distance / distance^(p + 1)
  double closely = 0;  // pixels: points no farther apart are tried in what is drawn (candidates.h); 0: the same few in each triangle
  const Horizon* horizon = nullptr;                // of kPixels and kArea; none: nothing is hidden
  double power() const { return area ? 1.5 : 1; }  // p
  double wakeMove() const { return kWakeMove * spare; }
  double wakeTurn() const { return kWakeTurn * spare; }

  // Whether a point, in metres relative to the camera, lies behind other ground, and by more than kHiddenMargin.
  bool hides(const camera::Vec3& p) const { return horizon && horizon->hidden(p, kHiddenMargin / pixelsPerRadian); }

  // A point in metres relative to the camera.
  camera::Vec3 relative(std::int32_t px, std::int32_t pz, double py) const {
    return {(double(px) - x) * lattice::kMetresPerStep, (py - y) * lattice::kMetresPerStep, (double(pz) - z) * lattice::kMetresPerStep};
  }
};

struct Pending {
  triangulation::TriangleId triangle;
  triangulation::Point2 point;
  float priority;  // the greater the earlier

  // A total order that depends on values only.
  friend bool operator<(const Pending& a, const Pending& b) {
    if (a.priority != b.priority) return a.priority > b.priority;
    return triangulation::smaller(a.point, b.point);
  }
};

// The largest error / distance^p that is still spared, from the threshold.
inline double sparedSlope(const View& view, double threshold) { return (view.moving ? kSlack * threshold : threshold) / view.gain; }

// Whether the camera has moved so far that a page's candidates asleep are judged again.
inline bool wakes(const PageScreen& page, const View& view) {
  return page.travel < 0 || view.travel - page.sleptTravel > (view.moving ? page.sleepsFor : 0);
}

// When a page with these bounds is due. `spared`: see above.
inline void setDue(PageDue& due, const PageScreen& page, double spared, const View& view) {
  const double power = view.power();
  // (1 - x)^p >= 1 - p x
  const double level = page.nearest * (1 - page.steepest / spared) / power,
               steep = page.nearest * (spared - page.seen) / (page.steepest + (power + 1) * spared);
  due.travel = page.travel < 0 ? kAlways : page.travel + std::max(level, steep);
  if (page.asleep == 0)
    due.turn = std::numeric_limits<double>::infinity();
  else if (wakes(page, view))
    due.travel = kAlways;
  else if (view.moving)
    due.travel = std::min(due.travel, page.sleptTravel + page.sleepsFor);
}
inline void join(PageDue& earliest, const PageDue& due) {
  earliest.travel = std::min(earliest.travel, due.travel);
  earliest.turn = std::min(earliest.turn, due.turn);
}

// A new candidate enters its page's bounds.
inline void foldCandidate(PageDue& due, PageScreen& page, RegionScreen& region, const Surface::Candidate& c, const View& view) {
  if (page.travel >= 0) {
    const auto moved = static_cast<float>(view.travel - page.travel);
    if (2 * moved >= page.nearest) {
      page.travel = -1;
    } else {
      if (moved > 0) {  // the bounds as they are after that way
        const float closer = page.nearest / (page.nearest - moved);
        const float faster = view.area ? closer * std::sqrt(closer) : closer;
        page.seen = (page.seen + page.steepest * moved / page.nearest) * faster * closer;
        page.steepest *= faster;
        page.nearest -= moved;
        page.travel = view.travel;
      }
      const float dx = static_cast<float>(c.point.x - view.x), dz = static_cast<float>(c.point.z - view.z),
                  dy = static_cast<float>(c.y) - view.y;
      const float flat = dx * dx + dz * dz, d = std::max(std::sqrt(flat + dy * dy), kNearest),
                  steep = c.error / (view.area ? d * std::sqrt(d) : d);
      page.steepest = std::max(page.steepest, steep);
      page.seen = std::max(page.seen, steep * std::sqrt(flat) / d);
      page.nearest = std::min(page.nearest, d);
    }
    setDue(due, page, region.spared, view);
  }
  join(region.due, due);
}

// A triangle's corners, in metres relative to the camera.
std::array<camera::Vec3, 3> cornersOf(const triangulation::Triangulation& mesh, const View& view, triangulation::TriangleId t);

// Appends the region's candidates at or above the threshold, sorted.
void screenPixels(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view,
                  double threshold, std::vector<Pending>& out);
void screenThesis(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                  double threshold, std::vector<Pending>& out);

}  // namespace ridgecast::refinement
