// Removal of a vertex: its star is a star-shaped cavity, filled by giving each base edge the corner whose circle is empty.
#include <algorithm>
#include <cassert>

#include "common/outcome/contract.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::triangulation {

// The star of v counter-clockwise: boundary_[i].from is a link vertex, boundary_[i].outer lies beyond the edge from -> to. False when the
// star or its ring leaves the write set. It begins at its smallest link vertex: which half-edge a vertex names depends on which thread was
// last, and which slots the fill gets on where the star begins.
bool Triangulation::collectStar(VertexId v, WriteSet& set) const {
  auto& boundary = set.boundary_;
  boundary.clear();
  set.cavity_.clear();
  const HalfEdge first = edgeOf(v);
  // The other way round, so that what comes last is fetched meanwhile.
  HalfEdge back = first;
  for (HalfEdge h = first;;) {
    const TriangleId t = h >> 2;
    if (!set.allows(triangles_.regionOf(t)) || !set.allows(triangles_.regionOf(back >> 2))) return false;
    back = next(twin(back));
    expects(origin(h) == v && boundary.size() < triangles_.capacity(), "a star is walked around its vertex, and ends where it began");
    const HalfEdge opposite = next(h), outer = twin(opposite);
    if (!set.allows(triangles_.regionOf(outer >> 2))) return false;
    set.cavity_.push_back(t);
    boundary.push_back({origin(opposite), origin(next(opposite)), outer, kOutside});
    __builtin_prefetch(&vertexRecords_[boundary.back().from]);
    h = twin(previous(h));
    if (h == first) break;
  }
  std::size_t least = 0;
  for (std::size_t k = 1; k < boundary.size(); ++k) {
    const VertexId link = boundary[k].from, smallest = boundary[least].from;
    if (smallest == kInfinite || (link != kInfinite && smaller(vertexRecords_[link].point(), vertexRecords_[smallest].point()))) least = k;
  }
  std::rotate(boundary.begin(), boundary.begin() + static_cast<std::ptrdiff_t>(least), boundary.end());
  std::rotate(set.cavity_.begin(), set.cavity_.begin() + static_cast<std::ptrdiff_t>(least), set.cavity_.end());
  return true;
}

// Fills the polygon boundary_[0..n).from; new triangles in fill_, corners as indices, a < b < c, (c, a) the base.
void Triangulation::fillStar(WriteSet& set) const {
  const auto& boundary = set.boundary_;
  const auto count = static_cast<std::uint32_t>(boundary.size());
  const RegionId home = triangles_.regionOf(set.cavity_.front());
  auto& link = set.link_;
  link.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) link[i] = vertexRecords_[boundary[i].from].point();
  set.fill_.clear();
  set.spans_.clear();
  set.spans_.push_back({0, count - 1, 0});
  // A ghost's circle is what lies beyond its hull edge, and the open edge itself.
  const auto beyond = [](const Point2& u, const Point2& w, const Point2& p) {
    const std::int64_t side = orientation(u, w, p);
    return side > 0 || (side == 0 && strictlyBetween(u, w, p));
  };
  while (!set.spans_.empty()) {
    const auto [i, j, parent] = set.spans_.back();
    set.spans_.pop_back();
    const VertexId a = boundary[i].from, c = boundary[j].from;
    std::uint32_t best = j, infinite = j;
    if (a == kInfinite) {
      for (std::uint32_t m = i + 1; m < j; ++m)
        if (best == j || beyond(link[best], link[j], link[m])) best = m;
    } else if (c == kInfinite) {
      for (std::uint32_t m = i + 1; m < j; ++m)
        if (best == j || beyond(link[i], link[best], link[m])) best = m;
    } else {
      for (std::uint32_t m = i + 1; m < j; ++m) {
        if (boundary[m].from == kInfinite) {
          infinite = m;
          continue;
        }
        if (j - i > 2 && orientation(link[i], link[m], link[j]) <= 0) continue;
        if (best == j || inCircle(link[i], link[best], link[j], link[m])) best = m;
      }
      if (best == j) best = infinite;  // nothing to the left of the base: it is a hull edge now
    }
    expects(best != j, "a base has a corner beyond it");
    RegionId region = kOutside;
    if ((a != kInfinite) & (c != kInfinite) & (boundary[best].from != kInfinite))
      region = regionOfSum(link[i].x + link[best].x + link[j].x, link[i].z + link[best].z + link[j].z, home);
    const auto fill = static_cast<std::uint32_t>(set.fill_.size());
    set.fill_.push_back({i, best, j, region, kNoEdge, parent});
    if (best - i > 1) set.spans_.push_back({i, best, 4 * fill});
    if (j - best > 1) set.spans_.push_back({best, j, 4 * fill + 1});
  }
}

Change Triangulation::plan(VertexId v, WriteSet& set) const {
  expects(v != kInfinite, "infinity stays");
  assert(vertices_.alive(v));
  if (!set.allows(vertices_.regionOf(v)) || !collectStar(v, set)) return Change::kDeferred;
  auto& boundary = set.boundary_;
  // The first base should be finite, so that "nothing to its left" has a meaning.
  const auto infinite = std::find_if(boundary.begin(), boundary.end(), [](const auto& b) { return b.from == kInfinite; });
  if (infinite != boundary.end())
    std::rotate(boundary.begin(), infinite == boundary.begin() ? boundary.end() - 1 : infinite - 1, boundary.end());
  if (boundary.size() < 3) return Change::kRefused;
  fillStar(set);
  bool anyFinite = infinite == boundary.end();
  for (const auto& f : set.fill_) {
    if (!set.allows(f.region)) return Change::kDeferred;
    anyFinite = anyFinite || (boundary[f.a].from != kInfinite && boundary[f.b].from != kInfinite && boundary[f.c].from != kInfinite);
  }
  if (!anyFinite) {  // only a hull vertex can leave a line behind: look whether any finite triangle survives
    const auto isRemoved = [&](TriangleId t) { return std::find(set.cavity_.begin(), set.cavity_.end(), t) != set.cavity_.end(); };
    for (const auto& b : boundary) anyFinite = anyFinite || (!isGhost(b.outer >> 2) && !isRemoved(b.outer >> 2));
    if (!anyFinite) return Change::kRefused;
  }
  return triangles_.hasFree(64 + static_cast<std::uint32_t>(boundary.size())) ? Change::kDone : Change::kFull;
}

Change Triangulation::apply(VertexId v, WriteSet& set) {
  const auto& boundary = set.boundary_;
  expects(!set.fill_.empty() && set.fill_.size() + 2 == set.cavity_.size(), "what is applied was planned, and not applied before");
  const auto& corners = triangleRecords_[set.cavity_.front()].v;
  expects(corners[0] == v || corners[1] == v || corners[2] == v, "a plan is applied to the vertex that it was made for");
  const RegionId home = triangles_.regionOf(set.cavity_.front());
  std::size_t spare = emptyCavity(home, set);
  for (auto& f : set.fill_) {
    f.id = takeSlot(f.region, home, set, spare);
    triangleRecords_[f.id] = {{boundary[f.a].from, boundary[f.b].from, boundary[f.c].from}, {kNoEdge, kNoEdge, kNoEdge}};
    setEdge(boundary[f.a].from, 4 * f.id);
    setEdge(boundary[f.b].from, 4 * f.id + 1);
    setEdge(boundary[f.c].from, 4 * f.id + 2);
  }
  while (spare > 0) triangles_.release(set.cavity_[--spare]);
  for (std::size_t n = 0; n < set.fill_.size(); ++n) {
    const auto& f = set.fill_[n];
    if (f.b - f.a == 1) link(4 * f.id, boundary[f.a].outer);
    if (f.c - f.b == 1) link(4 * f.id + 1, boundary[f.b].outer);
    link(4 * f.id + 2, n == 0 ? boundary.back().outer : 4 * set.fill_[f.parent >> 2].id + (f.parent & 3));
  }
  vertices_.release(v);
  return Change::kDone;
}

}  // namespace ridgecast::triangulation
