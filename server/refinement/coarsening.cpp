// Which vertices no longer earn their place.
//
// A vertex goes when everything that its removal would spoil stays small on screen: its own height against the surface without it, and the
// known candidates of its star against that surface. (Its own error alone is not enough: vertices that hold up their neighbours' candidates
// would come and go for ever.) The largest of these is its *loss*, a vertical error that does not depend on the camera. The loss last seen
// is kept as a filter: only vertices that pass with it are looked at again, and those that then fail keep the new one.
//
// The limit is half the threshold at which vertices are inserted, so nothing flickers.
#include <algorithm>
#include <bit>
#include <cmath>

#include "server/refinement/adaptive_mesh.h"
#include "server/refinement/bounds.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using triangulation::Change;
using triangulation::Point2;
using triangulation::Vertex;
using triangulation::VertexPages;

namespace {

constexpr std::size_t kLossesAhead = 8;  // pages whose bounds are fetched ahead of the one at hand
constexpr float kNone = std::numeric_limits<float>::max();

Place placeOf(const Vertex& v) { return {v.x, v.z, v.y}; }

// Slopes are errors as seen, the measure / the view's gain. All squared.
struct Seen {
  float slope2, flat2, distance2;
};
inline Seen see(const Place& p, float loss, const View& view) {
  const float dx = static_cast<float>(p.x - view.x), dz = static_cast<float>(p.z - view.z), dy = static_cast<float>(p.y) - view.y;
  const float flat = dx * dx + dz * dz, d2 = std::max(flat + dy * dy, kNearest * kNearest), reach = view.measure.reach(d2);
  return {loss * loss * flat / (d2 * reach), flat, d2};
}

void setNextCheck(PageLosses& page, double skipped, double power) {
  page.nextCheck = page.travel < 0 ? kAlways : page.travel + (1 - skipped / page.leastSlope) / (1 / page.flat + (power + 1) / page.nearest);
}

}  // namespace

double seenError(const Place& at, float error, const View& view) { return view.gain * std::sqrt(see(at, error, view).slope2); }

void AdaptiveMesh::findRemovable(RegionId region, const PageList& due, const View& view, Work& work) {
  RegionState& state = regions_[region];
  for (std::size_t n = 0; n < due.size(); ++n) {
    if (n + kPagesAhead < due.size()) prefetchVertices(due[n + kPagesAhead]);
    checkLosses(due[n], view, work.removalLimit / view.gain, work.removable);
    setNextCheck(losses_[due[n]], state.skippedLoss, view.measure.power());
    state.nextLossCheck = std::min(state.nextLossCheck, losses_[due[n]].nextCheck);
  }
}

void AdaptiveMesh::prefetchVertices(std::uint32_t page) const {
  for (std::uint32_t k = 0; k < VertexPages::kBlocks; ++k) {
    const std::uint32_t block = mesh_.vertexPages().blockOf(page, k);
    if (block == triangulation::kNoSlot) continue;
    mesh_.prefetchVertices(block);
    static_assert(VertexPages::kBlock * sizeof(VertexExtra) == 64);
    __builtin_prefetch(&extras_[block * VertexPages::kBlock]);
  }
}

// As collectDue().
void AdaptiveMesh::collectDueLosses(RegionId region, const View& view, double removalLimit, PageList& due) {
  RegionState& state = regions_[region];
  const double slope = removalLimit / view.gain, skipped = view.moving ? slope / kSlack : slope;
  const bool same = state.skippedLoss == skipped;
  if (!(slope > 0) || (same && view.travel < state.nextLossCheck)) return;
  state.skippedLoss = skipped;
  state.nextLossCheck = std::numeric_limits<double>::infinity();
  const auto& all = mesh_.vertexPages().pagesOf(region);
  for (std::size_t n = 0; n < all.size(); ++n) {
    if (n + kLossesAhead < all.size()) __builtin_prefetch(&losses_[all[n + kLossesAhead]]);
    PageLosses& known = losses_[all[n]];
    if (!same) setNextCheck(known, skipped, view.measure.power());
    if (view.travel < known.nextCheck) {
      state.nextLossCheck = std::min(state.nextLossCheck, known.nextCheck);
    } else {
      due.push_back(all[n]);
      mesh_.vertexPages().prefetch(all[n]);
    }
  }
}

// Appends the page's vertices below the slope, and keeps the bounds of the others.
inline void AdaptiveMesh::checkLosses(std::uint32_t page, const View& view, double slope, std::vector<VertexId>& out) {
  const auto most = static_cast<float>(slope * slope);
  float least = kNone, flattest = kNone, nearest = kNone;
  mesh_.vertexPages().forEachIn(page, mesh_.vertexPages().aliveMask(page), [&](VertexId v) {
    const float loss = extras_[v].loss;
    if (v == triangulation::kInfinite || std::isinf(loss)) return;
    const Seen seen = see(placeOf(mesh_.vertex(v)), loss, view);
    if (seen.slope2 < most) {
      out.push_back(v);
    } else {
      least = std::min(least, seen.slope2);
      flattest = std::min(flattest, seen.flat2);
      nearest = std::min(nearest, seen.distance2);
    }
  });
  losses_[page] = {0, view.travel, std::sqrt(least), std::sqrt(flattest), std::sqrt(nearest)};
}

// Keeps a vertex's loss, and its page's bounds learn of it.
void AdaptiveMesh::foldLoss(const Vertex& p, VertexId v, float loss, RegionId region, const View& view) {
  extras_[v].loss = loss;
  PageLosses& page = losses_[mesh_.vertexPages().pageOf(v)];
  RegionState& state = regions_[region];
  if (page.travel >= 0 && std::isfinite(loss)) {
    const auto moved = static_cast<float>(view.travel - page.travel);
    if (4 * moved >= std::min(page.flat, page.nearest)) {
      page.travel = -1;
    } else {
      if (moved > 0) {  // the bounds as they are after that way
        const float away = 1 + moved / page.nearest;
        page.leastSlope *= (1 - moved / page.flat) / (away * away * view.measure.rise(away));
        page.flat -= moved;
        page.nearest -= moved;
        page.travel = view.travel;
      }
      const Seen seen = see(placeOf(p), loss, view);
      page.leastSlope = std::min(page.leastSlope, std::sqrt(seen.slope2));
      page.flat = std::min(page.flat, std::sqrt(seen.flat2));
      page.nearest = std::min(page.nearest, std::sqrt(seen.distance2));
    }
    setNextCheck(page, state.skippedLoss, view.measure.power());
  }
  state.nextLossCheck = std::min(state.nextLossCheck, page.nextCheck);
}

// The loss in steps, times the weight of the triangle, by a plan for the removal that stays in `set` for apply(). Infinite
// where the vertex cannot go now: it lies on the hull or beside a triangle without a candidate yet, or its star leaves the write set.
float AdaptiveMesh::lossOf(VertexId v, const Measure& measure, triangulation::WriteSet& set) const {
  constexpr float never = std::numeric_limits<float>::infinity();
  if (mesh_.plan(v, set) != Change::kDone) return never;
  for (TriangleId t : set.star()) prefetchCandidate(t);
  for (TriangleId t : set.star())
    if (mesh_.isGhost(t) || mesh_.regionOf(t) == triangulation::kOutside || mesh_.trianglePages().fresh(t)) return never;
  double worst = 0;
  const auto judge = [&](Point2 p, double y) {
    bool found = false;
    set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
      if (found) return;
      const Vertex &va = mesh_.vertex(a), &vb = mesh_.vertex(b), &vc = mesh_.vertex(c);
      if (!triangulation::holds(va.point(), vb.point(), vc.point(), p)) return;
      found = true;
      worst = std::max(worst, std::abs(planeHeight(va, vb, vc, p) - y) * (measure.byArea ? measure.weight(areaOf(va, vb, vc)) : 1));
    });
  };
  judge(mesh_.vertex(v).point(), extras_[v].fineY);
  for (TriangleId t : set.star())
    if (const Candidate c = candidate(t); c.error != 0) judge(c.point, c.y);
  if (colour_.on()) worst = std::max(worst, colourLoss(v, measure, set));
  return static_cast<float>(worst);
}

// The same of colours, kept to a part of their bound.
double AdaptiveMesh::colourLoss(VertexId v, const Measure& measure, const triangulation::WriteSet& set) const {
  std::vector<Point2> points{mesh_.vertex(v).point()};
  for (TriangleId t : set.star())
    if (const Candidate c = candidate(t); c.error != 0) points.push_back(c.point);
  const std::size_t judged = points.size();
  std::vector<std::array<VertexId, 3>> fill;
  set.forEachFill([&](VertexId a, VertexId b, VertexId c) {
    fill.push_back({a, b, c});
    for (const VertexId corner : fill.back()) points.push_back(mesh_.vertex(corner).point());
  });
  std::vector<Tint> tints(points.size());
  colour_.tints(anchor_, points, regions_[mesh_.regionOfVertex(v)].level, tints);
  double worst = 0;
  for (std::size_t k = 0; k < judged; ++k)
    for (std::size_t f = 0; f < fill.size(); ++f) {
      const Vertex &a = mesh_.vertex(fill[f][0]), &b = mesh_.vertex(fill[f][1]), &c = mesh_.vertex(fill[f][2]);
      if (!triangulation::holds(a.point(), b.point(), c.point(), points[k])) continue;
      const Tint* const corner = &tints[judged + 3 * f];
      worst = std::max(worst, colour_.at({{{a, corner[0]}, {b, corner[1]}, {c, corner[2]}}}, points[k], tints[k], ColourError::kKept) *
                                  (measure.byArea ? measure.weight(areaOf(a, b, c)) : 1));
      break;
    }
  return worst;
}

void AdaptiveMesh::removeUnneeded(RegionId region, const View& view, triangulation::WriteSet& set, Work& work) {
  for (std::size_t k = 0; k < work.removable.size(); ++k) {
    if (k + 2 < work.removable.size()) mesh_.prefetch(mesh_.edgeOf(work.removable[k + 2]) >> 2);
    if (k + 1 < work.removable.size()) mesh_.prefetchNeighbours(mesh_.edgeOf(work.removable[k + 1]) >> 2);
    const VertexId v = work.removable[k];
    const Vertex& p = mesh_.vertex(v);
    const float loss = lossOf(v, view.measure, set);
    if (!std::isfinite(loss)) {
      wakeVertex(v, region);
      continue;
    }
    foldLoss(p, v, loss, region, view);
    if (seenError(placeOf(p), loss, view) >= work.removalLimit) continue;
    if (mesh_.apply(v, set) != Change::kDone) continue;
    set.forEachFilled([&](TriangleId t) { prefetchEvaluation(t); });
    ++work.removed;
  }
}

}  // namespace ridgecast::refinement
