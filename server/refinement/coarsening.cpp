#include "server/refinement/coarsening.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "server/refinement/candidates.h"

namespace ridgecast::refinement {

using triangulation::Change;
using triangulation::kInfinite;
using triangulation::orientation;
using triangulation::Point2;
using triangulation::TriangleId;
using triangulation::Triangulation;
using triangulation::Vertex;
using triangulation::VertexId;

namespace {

constexpr std::size_t kAhead = 8;  // pages whose bounds are fetched ahead of the one at hand
constexpr float kNone = std::numeric_limits<float>::max();

Place placeOf(const Vertex& v) { return {v.x, v.z, v.y}; }

// Slopes are errors as seen, the measure / the view's gain. All squared.
struct Seen {
  float slope2, flat2, distance2;
};
inline Seen see(const Place& p, float loss, const View& view) {
  const float dx = static_cast<float>(p.x - view.x), dz = static_cast<float>(p.z - view.z), dy = static_cast<float>(p.y) - view.y;
  const float flat = dx * dx + dz * dz, d2 = std::max(flat + dy * dy, kNearest * kNearest), reach = view.area ? d2 * std::sqrt(d2) : d2;
  return {loss * loss * flat / (d2 * reach), flat, d2};
}

void setDue(PageLosses& page, double spared, double power) {
  page.due = page.travel < 0 ? kAlways : page.travel + (1 - spared / page.leastSlope) / (1 / page.flat + (power + 1) / page.nearest);
}

}  // namespace

double measure(const Place& at, float error, const View& view) { return view.gain * std::sqrt(see(at, error, view).slope2); }

void screenLosses(const Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view, double limit,
                  std::vector<VertexId>& out) {
  using triangulation::VertexPages;
  RegionScreen& screen = surface.regions[region];
  const double slope = limit / view.gain, spared = view.moving ? slope / kSlack : slope;
  const bool same = screen.lossesSpared == spared;
  if (same && view.travel < screen.lossesDue) return;
  screen.lossesSpared = spared;
  screen.lossesDue = std::numeric_limits<double>::infinity();
  const VertexPages& pages = mesh.vertexPages();
  const auto most = static_cast<float>(slope * slope);
  const auto& all = pages.pagesOf(region);
  thread_local std::vector<std::uint32_t> due;
  due.clear();
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kAhead < all.size()) __builtin_prefetch(&surface.losses[all[n + kAhead]]);
    PageLosses& known = surface.losses[all[n]];
    if (!same) setDue(known, spared, view.power());
    if (view.travel < known.due)
      screen.lossesDue = std::min(screen.lossesDue, known.due);
    else
      due.push_back(all[n]);
  }
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + 1 < due.size()) {
      mesh.prefetchVertices(due[n + 1]);
      surface.prefetchVertices(due[n + 1]);
    }
    PageLosses& known = surface.losses[due[n]];
    float least = kNone, flattest = kNone, nearest = kNone;
    for (triangulation::VertexPages::Mask m = pages.aliveMask(due[n]); m != 0; m &= m - 1) {
      const VertexId v = due[n] * VertexPages::kSlots + static_cast<VertexId>(std::countr_zero(m));
      const float loss = surface.vertices[v].loss;
      if (v == kInfinite || std::isinf(loss)) continue;
      const Seen seen = see(placeOf(mesh.vertex(v)), loss, view);
      if (seen.slope2 < most) {
        out.push_back(v);
      } else {
        least = std::min(least, seen.slope2);
        flattest = std::min(flattest, seen.flat2);
        nearest = std::min(nearest, seen.distance2);
      }
    }
    known = {0, view.travel, std::sqrt(least), std::sqrt(flattest), std::sqrt(nearest)};
    setDue(known, spared, view.power());
    screen.lossesDue = std::min(screen.lossesDue, known.due);
  }
}

void foldLoss(const Vertex& p, VertexId v, float loss, triangulation::RegionId region, const View& view, Surface& surface) {
  surface.vertices[v].loss = loss;
  PageLosses& page = surface.losses[v / triangulation::VertexPages::kSlots];
  RegionScreen& screen = surface.regions[region];
  if (page.travel >= 0 && std::isfinite(loss)) {
    const auto moved = static_cast<float>(view.travel - page.travel);
    if (4 * moved >= std::min(page.flat, page.nearest)) {
      page.travel = -1;
    } else {
      if (moved > 0) {  // the bounds as they are after that way
        const float away = 1 + moved / page.nearest;
        page.leastSlope *= (1 - moved / page.flat) / (away * away * (view.area ? std::sqrt(away) : 1));
        page.flat -= moved;
        page.nearest -= moved;
        page.travel = view.travel;
      }
      const Seen seen = see(placeOf(p), loss, view);
      page.leastSlope = std::min(page.leastSlope, std::sqrt(seen.slope2));
      page.flat = std::min(page.flat, std::sqrt(seen.flat2));
      page.nearest = std::min(page.nearest, std::sqrt(seen.distance2));
    }
    setDue(page, screen.lossesSpared, view.power());
  }
  screen.lossesDue = std::min(screen.lossesDue, page.due);
}

float lossOf(const Triangulation& mesh, const Surface& surface, VertexId v, bool area, triangulation::WriteSet& set) {
  constexpr float never = std::numeric_limits<float>::infinity();
  if (mesh.plan(v, set) != Change::kDone) return never;
  for (TriangleId t : set.star())
    if (mesh.isGhost(t) || mesh.regionOf(t) == triangulation::kOutside || mesh.trianglePages().fresh(t)) return never;
  double worst = 0;
  const auto judge = [&](Point2 p, double y) {
    bool found = false;
    set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
      if (found) return;
      const Vertex &va = mesh.vertex(a), &vb = mesh.vertex(b), &vc = mesh.vertex(c);
      if (orientation(va.point(), vb.point(), p) < 0 || orientation(vb.point(), vc.point(), p) < 0 ||
          orientation(vc.point(), va.point(), p) < 0)
        return;
      found = true;
      worst = std::max(worst, std::abs(planeHeight(va, vb, vc, p) - y) * (area ? areaWeight(va, vb, vc) : 1));
    });
  };
  judge(mesh.vertex(v).point(), surface.vertices[v].fineY);
  for (TriangleId t : set.star())
    if (const Surface::Candidate c = surface.candidate(t); c.error != 0) judge(c.point, c.y);
  return static_cast<float>(worst);
}

}  // namespace ridgecast::refinement
