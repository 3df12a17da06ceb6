// Removal of a vertex: its star is a star-shaped hole, filled by giving each base edge the corner whose circle is empty.
#include <algorithm>
#include <cassert>

#include "server/triangulation/triangulation.h"

namespace ridgecast::triangulation {

// The star of v counter-clockwise: border_[i].from is a link vertex, border_[i].outer lies beyond the edge from -> to. False when the
// star or its ring leaves the write set. It begins at its smallest link vertex: which half-edge a vertex names depends on which thread was
// last, and which slots the fill gets on where the star begins.
bool Triangulation::collectStar(VertexId v, WriteSet& set) const {
  auto& border = set.border_;
  border.clear();
  set.hole_.clear();
  const HalfEdge first = edgeOf(v);
  std::size_t least = 0;
  for (HalfEdge h = first;;) {
    const TriangleId t = h >> 2;
    if (!set.allows(triangles_.regionOf(t))) return false;
    assert(origin(h) == v);
    const HalfEdge opposite = next(h), outer = twin(opposite);
    if (!set.allows(triangles_.regionOf(outer >> 2))) return false;
    set.hole_.push_back(t);
    border.push_back({origin(opposite), origin(next(opposite)), outer, kOutside});
    const VertexId link = border.back().from, smallest = border[least].from;
    if (smallest == kInfinite || (link != kInfinite && smaller(vertexRecords_[link].point(), vertexRecords_[smallest].point())))
      least = border.size() - 1;
    h = twin(previous(h));
    if (h == first) break;
  }
  std::rotate(border.begin(), border.begin() + static_cast<std::ptrdiff_t>(least), border.end());
  std::rotate(set.hole_.begin(), set.hole_.begin() + static_cast<std::ptrdiff_t>(least), set.hole_.end());
  return true;
}

// Fills the polygon border_[0..n).from; new triangles in fill_, corners as indices, a < b < c, (c, a) the base.
void Triangulation::fillStar(WriteSet& set) const {
  const auto& border = set.border_;
  const auto count = static_cast<std::uint32_t>(border.size());
  const RegionId home = triangles_.regionOf(set.hole_.front());
  auto& link = set.link_;
  link.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) link[i] = vertexRecords_[border[i].from].point();
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
    const VertexId a = border[i].from, c = border[j].from;
    std::uint32_t best = j, infinite = j;
    if (a == kInfinite) {
      for (std::uint32_t m = i + 1; m < j; ++m)
        if (best == j || beyond(link[best], link[j], link[m])) best = m;
    } else if (c == kInfinite) {
      for (std::uint32_t m = i + 1; m < j; ++m)
        if (best == j || beyond(link[i], link[best], link[m])) best = m;
    } else {
      for (std::uint32_t m = i + 1; m < j; ++m) {
        if (border[m].from == kInfinite) {
          infinite = m;
          continue;
        }
        if (j - i > 2 && orientation(link[i], link[m], link[j]) <= 0) continue;
        if (best == j || inCircle(link[i], link[best], link[j], link[m])) best = m;
      }
      if (best == j) best = infinite;  // nothing to the left of the base: it is a hull edge now
    }
    assert(best != j);
    RegionId region = kOutside;
    if ((a != kInfinite) & (c != kInfinite) & (border[best].from != kInfinite))
      region = regionOfSum(link[i].x + link[best].x + link[j].x, link[i].z + link[best].z + link[j].z, home);
    const auto fill = static_cast<std::uint32_t>(set.fill_.size());
    set.fill_.push_back({i, best, j, region, kNoEdge, parent});
    if (best - i > 1) set.spans_.push_back({i, best, 4 * fill});
    if (j - best > 1) set.spans_.push_back({best, j, 4 * fill + 1});
  }
}

Change Triangulation::plan(VertexId v, WriteSet& set) const {
  assert(v != kInfinite);
  if (!set.allows(vertices_.regionOf(v)) || !collectStar(v, set)) return Change::kDeferred;
  auto& border = set.border_;
  // The first base should be finite, so that "nothing to its left" has a meaning.
  const auto infinite = std::find_if(border.begin(), border.end(), [](const auto& b) { return b.from == kInfinite; });
  if (infinite != border.end()) std::rotate(border.begin(), infinite == border.begin() ? border.end() - 1 : infinite - 1, border.end());
  if (border.size() < 3) return Change::kRefused;
  fillStar(set);
  bool anyFinite = infinite == border.end();
  for (const auto& f : set.fill_) {
    if (!set.allows(f.region)) return Change::kDeferred;
    anyFinite = anyFinite || (border[f.a].from != kInfinite && border[f.b].from != kInfinite && border[f.c].from != kInfinite);
  }
  if (!anyFinite) {  // only a hull vertex can leave a line behind: look whether any finite triangle survives
    const auto isHole = [&](TriangleId t) { return std::find(set.hole_.begin(), set.hole_.end(), t) != set.hole_.end(); };
    for (const auto& b : border) anyFinite = anyFinite || (!isGhost(b.outer >> 2) && !isHole(b.outer >> 2));
    if (!anyFinite) return Change::kRefused;
  }
  return triangles_.hasFree(64 + static_cast<std::uint32_t>(border.size())) ? Change::kDone : Change::kFull;
}

Change Triangulation::apply(VertexId v, WriteSet& set) {
  const auto& border = set.border_;
  const RegionId home = triangles_.regionOf(set.hole_.front());
  triangles_.markChanged(home);
  std::size_t spare = 0;
  for (TriangleId t : set.hole_) {
    if (triangles_.regionOf(t) == home)
      set.hole_[spare++] = t;
    else
      triangles_.release(t);
  }
  for (auto& f : set.fill_) {
    if (f.region == home && spare > 0)
      triangles_.renew(f.id = set.hole_[--spare]);
    else
      f.id = triangles_.allocate(f.region);
    triangleRecords_[f.id] = {{border[f.a].from, border[f.b].from, border[f.c].from}, {kNoEdge, kNoEdge, kNoEdge}};
    setEdge(border[f.a].from, 4 * f.id);
    setEdge(border[f.b].from, 4 * f.id + 1);
    setEdge(border[f.c].from, 4 * f.id + 2);
  }
  while (spare > 0) triangles_.release(set.hole_[--spare]);
  for (std::size_t n = 0; n < set.fill_.size(); ++n) {
    const auto& f = set.fill_[n];
    if (f.b - f.a == 1) link(4 * f.id, border[f.a].outer);
    if (f.c - f.b == 1) link(4 * f.id + 1, border[f.b].outer);
    link(4 * f.id + 2, n == 0 ? border.back().outer : 4 * set.fill_[f.parent >> 2].id + (f.parent & 3));
  }
  vertices_.release(v);
  return Change::kDone;
}

}  // namespace ridgecast::triangulation
