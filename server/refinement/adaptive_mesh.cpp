#include "server/refinement/adaptive_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "common/mesh/extraction.h"
#include "common/outcome/contract.h"
#include "server/refinement/bounds.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using triangulation::Change;
using triangulation::kNoEdge;
using triangulation::kOutside;
using triangulation::Move;
using triangulation::Point2;
using triangulation::TrianglePages;
using triangulation::Vertex;
using triangulation::VertexPages;
using triangulation::WriteSet;

AdaptiveMesh::AdaptiveMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, Metric metric,
                           const triangulation::Partition& partition, double colourError)
    : mesh_(triangles, partition),
      partition_(partition),
      metric_(metric),
      candidates_(mesh_),
      losses_(mesh_),
      chooser_(mesh_, std::move(terrain), metric, colourError),
      regions_(1) {
  regions_[kOutside].level = kOutsideLevel;
  everything_.allowAll();
}

void AdaptiveMesh::setAnchor(lattice::Point anchor) {
  const auto dx = static_cast<std::int32_t>(anchor_.x - anchor.x), dz = static_cast<std::int32_t>(anchor_.z - anchor.z);
  anchor_ = anchor;
  if (mesh_.empty()) return;
  mesh_.translate(dx, dz);
  candidates_.translate(dx, dz);
}

// ---- regions ----

triangulation::RegionId AdaptiveMesh::addRegion(const triangulation::Square& square, int level) {
  expects(level >= 0 && level <= lattice::kMaxLevel, "a region has the level of a leaf");
  const RegionId region = mesh_.addRegion(square);
  if (region >= regions_.size()) regions_.resize(region + 1);
  regions_[region] = {};
  regions_[region].level = level;
  return region;
}

bool AdaptiveMesh::split(std::span<const RegionId> regions, const triangulation::Triangulation::Loop& loop) {
  return mesh_.split(regions, loop, moves(nullptr));
}

void AdaptiveMesh::refile(RegionId region, std::vector<VertexId>& moved) { mesh_.refile(region, moves(&moved)); }

void AdaptiveMesh::takeFreshVertices(RegionId region, std::vector<VertexId>& out) {
  const VertexPages& pages = mesh_.vertexPages();
  mesh_.vertexPages().takeFresh(
      region, [&](std::uint32_t page, VertexPages::Mask slots) { pages.forEachIn(page, slots, [&](VertexId v) { out.push_back(v); }); });
}

void AdaptiveMesh::compact(RegionId region) { mesh_.compact(region, moves(nullptr)); }

triangulation::Moves AdaptiveMesh::moves(std::vector<VertexId>* moved) {
  return {[this](std::span<const Move> list) { candidates_.move(list, regions_[mesh_.regionOf(list.front().to)]); },
          [this, moved](std::span<const Move> list) {
            losses_.move(list, stateOf(list.front().to));
            chooser_.moveCurvatures(list);
            if (moved)
              for (const Move& move : list) moved->push_back(move.to);
          }};
}

// ---- vertices ----

triangulation::Vertex AdaptiveMesh::vertexAt(const GridPoint& p) const {
  const Point2 q = local(p.at);
  return {q.x, q.z, lattice::snapHeight(p.y, levelAt(q)), kNoEdge};
}

void AdaptiveMesh::start(const GridPoint& a, const GridPoint& b, const GridPoint& c) {
  mesh_.start(vertexAt(a), vertexAt(b), vertexAt(c));
  const TriangleId first = mesh_.twin(mesh_.anyTriangle() * 4) >> 2;
  const auto& corners = mesh_.triangle(first).v;
  for (VertexId v : corners)
    for (const GridPoint& p : {a, b, c})
      if (mesh_.vertex(v).point() == local(p.at)) losses_.put(v, p.y, levelAt(local(p.at)), LossStore::kFixed);
  chooser_.addCurvatures(corners, anchor_);
}

void AdaptiveMesh::insertGrid(std::span<const GridPoint> points, TriangleId& hint) {
  std::vector<VertexId> inserted;
  for (const GridPoint& p : points) {
    const Point2 at = local(p.at);
    const TriangleId t = mesh_.locate(at, hint, everything_);
    VertexId v;
    const Change change = mesh_.insert(vertexAt(p), t, everything_, &v);
    if (change == Change::kFull) throw std::bad_alloc();
    if (change == Change::kDone) {
      losses_.put(v, p.y, levelAt(at), LossStore::kFixed);
      inserted.push_back(v);
      hint = mesh_.edgeOf(v) >> 2;
    } else {  // refinement was here before
      for (VertexId corner : mesh_.triangle(t).v)
        if (corner != triangulation::kInfinite && mesh_.vertex(corner).point() == at) setFixed(corner, true);
      hint = t;
    }
  }
  chooser_.addCurvatures(inserted, anchor_);
}

triangulation::Vertex AdaptiveMesh::vertexAt(const StoredVertex& p) const {
  const Point2 q = local(p.at);
  return {q.x, q.z, lattice::snapHeight(p.y, p.level), kNoEdge};
}

void AdaptiveMesh::store(RegionId region, std::vector<StoredVertex>& out) const {
  const auto first = static_cast<std::ptrdiff_t>(out.size());
  mesh_.vertexPages().forEach(region, [&](VertexId v) {
    if (v == triangulation::kInfinite) return;
    out.push_back({absolute(mesh_.vertex(v).point()), extra(v).fineY, static_cast<std::int32_t>(extra(v).level)});
  });
  std::sort(out.begin() + first, out.end(), [](const StoredVertex& l, const StoredVertex& r) { return l.at < r.at; });
}

// Three that are not on a line. False: there are none.
bool AdaptiveMesh::startFrom(std::span<const StoredVertex> vertices) {
  for (std::size_t k = 2; k < vertices.size(); ++k)
    if (orientation(local(vertices[0].at), local(vertices[1].at), local(vertices[k].at)) != 0) {
      mesh_.start(vertexAt(vertices[0]), vertexAt(vertices[1]), vertexAt(vertices[k]));
      return true;
    }
  return false;
}

bool AdaptiveMesh::restore(std::span<const StoredVertex> vertices, const std::vector<bool>& fixed) {
  expects(mesh_.empty() && fixed.size() == vertices.size(), "what is restored is empty");
  constexpr lattice::Step kReach = lattice::Step{1} << 25;
  for (const StoredVertex& p : vertices) {
    const bool isNear = std::abs(p.at.x - anchor_.x) < kReach && std::abs(p.at.z - anchor_.z) < kReach;
    if (!isNear || std::abs(p.y) > lattice::kMaxHeight || p.level < 0 || p.level > lattice::kMaxLevel) return false;
  }
  if (!startFrom(vertices)) return false;
  std::vector<VertexId> restored;
  restored.reserve(vertices.size());
  TriangleId hint = mesh_.anyTriangle();
  const auto put = [&](const StoredVertex& p, bool isFixed) {
    const Point2 at = local(p.at);
    hint = mesh_.locate(at, hint, everything_);
    VertexId v = triangulation::kInfinite;
    const Change change = mesh_.insert(vertexAt(p), hint, everything_, &v);
    if (change == Change::kDone)
      hint = mesh_.edgeOf(v) >> 2;
    else if (change != Change::kDuplicate)
      return false;
    else
      for (VertexId corner : mesh_.triangle(hint).v)  // one that it began with, or it is there twice
        if (corner != triangulation::kInfinite && mesh_.vertex(corner).point() == at) v = corner;
    expects(v != triangulation::kInfinite, "a point that is there is a vertex");
    RegionState& state = stateOf(v);
    losses_.put(v, p.y, p.level, isFixed ? LossStore::kFixed : 0);
    losses_.wake(v, state);
    state.ground.add({p.y, p.y});
    restored.push_back(v);
    return true;
  };
  // The grids first: they bound what the others change.
  for (const bool isFixed : {true, false})
    for (std::size_t k = 0; k < vertices.size(); ++k)
      if (fixed[k] == isFixed && !put(vertices[k], isFixed)) return false;
  chooser_.addCurvatures(restored, anchor_);
  return mesh_.liveVertices() == vertices.size();
}

void AdaptiveMesh::drop(VertexId v) {
  [[maybe_unused]] const Change change = mesh_.remove(v, everything_);
  expects(change == Change::kDone, "what was planned can be done");
}

void AdaptiveMesh::snap(VertexId v) {
  const int level = stateOf(v).level;
  if (static_cast<int>(extra(v).level) <= level + 1) return;
  const std::int32_t y = losses_.snapTo(v, level);
  if (y == mesh_.vertex(v).y) return;
  setHeight(v, y);
  mesh_.forEachAround(v, [&](triangulation::HalfEdge h) {
    mesh_.trianglePages().setFresh(h >> 2);
    mesh_.markChanged(mesh_.regionOf(h >> 2));
  });
}

// ---- other ground ----

void AdaptiveMesh::raiseVertices(RegionId region) {
  std::vector<VertexId> inside;
  std::vector<lattice::Point> places;
  if (!mesh_.vertexPages().hasRegion(region)) return;
  mesh_.vertexPages().forEach(region, [&](VertexId v) {
    const lattice::Point p = absolute(mesh_.vertex(v).point());
    if (std::ranges::none_of(chooser_.changed(), [&](const lattice::Area& a) { return a.holds(p); })) return;
    inside.push_back(v);
    places.push_back(p);
  });
  const std::vector<std::int32_t> heights = heightsAt(places);
  chooser_.addCurvatures(inside, anchor_);
  for (std::size_t k = 0; k < inside.size(); ++k) {
    const VertexId v = inside[k];
    const std::int32_t y = losses_.raise(v, heights[k], regions_[region]);
    if (y != mesh_.vertex(v).y) setHeight(v, y);
  }
}

void AdaptiveMesh::refreshTriangles(RegionId region) {
  TrianglePages& pages = mesh_.trianglePages();
  if (!pages.hasRegion(region)) return;
  bool any = false;
  pages.forEach(region, [&](TriangleId t) {
    if (mesh_.isGhost(t)) return;
    const auto& v = mesh_.triangle(t).v;
    const lattice::Area box = boxOf(mesh_.vertex(v[0]), mesh_.vertex(v[1]), mesh_.vertex(v[2]), anchor_);
    if (std::ranges::none_of(chooser_.changed(), [&](const lattice::Area& a) { return a.meets(box); })) return;
    pages.setFresh(t);
    any = true;
  });
  if (any) mesh_.markChanged(region);
}

// ---- refinement ----

std::uint32_t AdaptiveMesh::findWork(std::span<const Search> searches, const View& view, double threshold) {
  expects(searches.size() <= 32, "a search has its bit");
  struct Due {  // pages
    PageList candidates, losses;
  };
  thread_local std::vector<Due> due;
  if (due.size() < searches.size()) due.resize(searches.size());
  const bool isThesis = metric_ == Metric::kThesis;
  for (std::size_t k = 0; k < searches.size(); ++k) {
    const auto& [region, isSeen, removalLimit, work] = searches[k];
    due[k].candidates.clear();
    due[k].losses.clear();
    if (isSeen && !isThesis) candidates_.collectDue(region, regions_[region], view, skippedSlope(view, threshold), due[k].candidates);
    losses_.collectDue(region, regions_[region], view, removalLimit, due[k].losses);
  }
  const auto first = [](const PageList& pages) { return std::span(pages).first(std::min(kPagesAhead, pages.size())); };
  for (std::size_t k = 0; k < searches.size(); ++k) {
    for (std::uint32_t page : first(due[k].candidates)) candidates_.prefetchPage(page);
    for (std::uint32_t page : first(due[k].losses)) losses_.prefetchPage(page);
  }
  std::uint32_t found = 0;
  for (std::size_t k = 0; k < searches.size(); ++k) {
    const auto& [region, isSeen, removalLimit, work] = searches[k];
    const bool screens = isSeen && isThesis, checks = !due[k].candidates.empty(), judges = !due[k].losses.empty();
    if (!screens && !checks && !judges) continue;
    if (screens) candidates_.findByThesis(region, view, threshold, work->pending);
    if (checks) candidates_.findWanted(due[k].candidates, regions_[region], view, threshold, work->pending);
    if (judges) {
      work->removalLimit = removalLimit;
      losses_.findRemovable(due[k].losses, regions_[region], view, *work);
    }
    if (!work->isEmpty()) found |= 1u << k;
  }
  return found;
}

double AdaptiveMesh::postpone(const Pending& wanted, RegionId region, const View& view, bool pageAnew) {
  const Candidate c = candidate(wanted.triangle);
  expects(c.error > 0, "what is postponed is wanted");
  if (pageAnew)
    candidates_.wake(wanted.triangle, regions_[region]);
  else
    candidates_.fold(wanted.triangle, c, regions_[region], view);
  return seenError({c.point.x, c.point.z, c.y}, c.error, view);
}

// False: the change would leave the write set.
bool AdaptiveMesh::insertOne(const Pending& wanted, RegionId region, const View& view, WriteSet& set, Work& work) {
  const TrianglePages& pages = mesh_.trianglePages();
  const Candidate c = candidate(wanted.triangle);
  // Its triangle is gone, and perhaps another in its place: judged again next time.
  if (!pages.alive(wanted.triangle) || pages.fresh(wanted.triangle) || !(c.point == wanted.point)) return true;
  const int level = levelAt(c.point);
  VertexId v;
  const Change change = mesh_.insert({c.point.x, c.point.z, lattice::snapHeight(c.y, level), kNoEdge}, wanted.triangle, set, &v);
  if (change == Change::kDeferred) return false;
  if (change != Change::kDone) {
    candidates_.wake(wanted.triangle, regions_[region]);
    return true;
  }
  mesh_.forEachAround(v, [&](triangulation::HalfEdge h) { candidates_.prefetchAll(h >> 2); });
  losses_.put(v, c.y, level, c.error);
  losses_.fold(v, c.error, stateOf(v), view);
  chooser_.addCurvatures({&v, 1}, anchor_);
  ++work.inserted;
  return true;
}

void AdaptiveMesh::insertWanted(RegionId region, const View& view, WriteSet& set, Work& work) {
  work.deferred.clear();
  const std::vector<Pending>& pending = work.pending;
  constexpr std::size_t kAhead = 3;
  const auto fetch = [&](std::size_t k) {
    if (k >= pending.size()) return;
    mesh_.prefetchCorners(pending[k].triangle);
    mesh_.prefetchNeighbours(pending[k].triangle);
  };
  for (std::size_t k = 0; k < kAhead; ++k) fetch(k);
  for (std::size_t k = 0; k < pending.size(); ++k) {
    fetch(k + kAhead);
    if (k + 1 < pending.size())
      for (triangulation::HalfEdge h : mesh_.triangle(pending[k + 1].triangle).twin) mesh_.prefetchCorners(h >> 2);
    if (!insertOne(pending[k], region, view, set, work)) work.deferred.push_back(pending[k]);
  }
}

void AdaptiveMesh::insertDeferred(RegionId region, const View& view, Work& work) {
  for (const Pending& wanted : work.deferred) insertOne(wanted, region, view, everything_, work);
}

void AdaptiveMesh::evaluateAll(RegionId region, const View& view) {
  TrianglePages& pages = mesh_.trianglePages();
  pages.forEach(region, [&](TriangleId t) { pages.setFresh(t); });
  evaluateFresh(region, &view);
}

void AdaptiveMesh::evaluateFresh(RegionId region, const View* view) {
  thread_local std::vector<TriangleId> fresh;
  fresh.clear();
  const TrianglePages& pages = mesh_.trianglePages();
  mesh_.trianglePages().takeFresh(region, [&](std::uint32_t page, TrianglePages::Mask slots) {
    if (slots == pages.aliveMask(page)) candidates_.begin(page, view ? view->travel : -1);
    pages.forEachIn(page, slots, [&](TriangleId t) {
      fresh.push_back(t);
      candidates_.prefetchAll(t);
    });
  });
  if (fresh.empty()) return;
  RegionState& state = regions_[region];
  const Chooser::Choice chosen = chooser_.choose(fresh, anchor_, state.level, view);
  for (std::size_t k = 0; k < fresh.size(); ++k) {
    if (k + 16 < fresh.size()) candidates_.prefetchAll(fresh[k + 16]);  // of many, the first ones went out of the cache again
    candidates_.put(fresh[k], chosen.candidates[k], chosen.terms[k]);
    if (view)
      candidates_.fold(fresh[k], chosen.candidates[k], state, *view);
    else
      candidates_.wake(fresh[k], state);
  }
  state.ground.add(chosen.seen);
}

// ---- removal ----
//
// A vertex goes when everything that its removal would spoil stays small on screen: its own height against the surface without it, and the
// known candidates of its star against that surface. (Its own error alone is not enough: vertices that hold up their neighbours' candidates
// would come and go for ever.) The largest of these is its *loss*, a vertical error that does not depend on the camera. The limit is half
// the threshold at which vertices are inserted, so nothing flickers.

void AdaptiveMesh::removeUnneeded(RegionId region, const View& view, WriteSet& set, Work& work) {
  for (std::size_t k = 0; k < work.removable.size(); ++k) {
    if (k + 2 < work.removable.size()) mesh_.prefetch(mesh_.edgeOf(work.removable[k + 2]) >> 2);
    if (k + 1 < work.removable.size()) mesh_.prefetchNeighbours(mesh_.edgeOf(work.removable[k + 1]) >> 2);
    const VertexId v = work.removable[k];
    const Vertex& p = mesh_.vertex(v);
    const float loss = lossOf(v, view.measure, set);
    if (!std::isfinite(loss)) {
      losses_.wake(v, regions_[region]);
      continue;
    }
    losses_.fold(v, loss, regions_[region], view);
    if (seenError({p.x, p.z, p.y}, loss, view) >= work.removalLimit) continue;
    if (mesh_.apply(v, set) != Change::kDone) continue;
    set.forEachFilled([&](TriangleId t) { candidates_.prefetchAll(t); });
    ++work.removed;
  }
}

// The loss in steps, times the weight of the triangle, by a plan for the removal that stays in `set` for apply(). Infinite
// where the vertex cannot go now: it lies on the hull or beside a triangle without a candidate yet, or its star leaves the write set.
float AdaptiveMesh::lossOf(VertexId v, const Measure& measure, triangulation::WriteSet& set) const {
  constexpr float never = std::numeric_limits<float>::infinity();
  if (mesh_.plan(v, set) != Change::kDone) return never;
  for (TriangleId t : set.star()) candidates_.prefetch(t);
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
  judge(mesh_.vertex(v).point(), extra(v).fineY);
  for (TriangleId t : set.star())
    if (const Candidate c = candidate(t); c.error != 0) judge(c.point, c.y);
  if (chooser_.colour().on()) worst = std::max(worst, colourLoss(v, measure, set));
  return static_cast<float>(worst);
}

// The same of colours, kept to a part of their bound.
double AdaptiveMesh::colourLoss(VertexId v, const Measure& measure, const triangulation::WriteSet& set) const {
  const ColourError& colour = chooser_.colour();
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
  colour.tints(anchor_, points, regions_[mesh_.regionOfVertex(v)].level, tints);
  double worst = 0;
  for (std::size_t k = 0; k < judged; ++k)
    for (std::size_t f = 0; f < fill.size(); ++f) {
      const Vertex &a = mesh_.vertex(fill[f][0]), &b = mesh_.vertex(fill[f][1]), &c = mesh_.vertex(fill[f][2]);
      if (!triangulation::holds(a.point(), b.point(), c.point(), points[k])) continue;
      const Tint* const corner = &tints[judged + 3 * f];
      worst = std::max(worst, colour.at({{{a, corner[0]}, {b, corner[1]}, {c, corner[2]}}}, points[k], tints[k], ColourError::kKept) *
                                  (measure.byArea ? measure.weight(areaOf(a, b, c)) : 1));
      break;
    }
  return worst;
}

// ---- reading ----

mesh::LeafMesh AdaptiveMesh::extract(RegionId region, lattice::LeafAddress leaf) const {
  thread_local mesh::Extractor extractor;  // for its memory
  mesh::LeafMesh out = extractor.extract(mesh_, region, leaf, anchor_);
  mesh::canonicalize(out);
  return out;
}

void AdaptiveMesh::list(RegionId region, const View& view, std::vector<ListedCandidate>& out) const {
  mesh_.trianglePages().forEach(region, [&](TriangleId t) {
    const Candidate c = candidate(t);
    if (!(c.error > 0)) return;
    const camera::Vec3 at = view.relative(c.point.x, c.point.z, c.y);
    const double error = c.error / view.measure.weight(areaOf(mesh_, t));
    if (!view.wide.contains(at) && !view.wide.meets(cornersOf(mesh_, view, t), error * lattice::kMetresPerStep)) return;
    const double flat = at.x * at.x + at.z * at.z, d2 = std::max(flat + at.y * at.y, 0.25);
    const double pixels = error * lattice::kMetresPerStep * view.pixelsPerRadian * std::sqrt(flat) / d2;
    out.push_back({c.point, c.y, static_cast<float>(pixels)});
  });
}

void keepWorst(std::vector<ListedCandidate>& candidates, std::size_t most) {
  if (candidates.size() > most) {
    std::nth_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(most), candidates.end());
    candidates.resize(most);
  }
  std::sort(candidates.begin(), candidates.end());
}

}  // namespace ridgecast::refinement
