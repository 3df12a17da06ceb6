// Removal of a vertex: its star is a star-shaped hole, filled by giving each base edge the corner whose circle is empty.
#include <algorithm>
#include <cassert>

#include "server/triangulation/triangulation.h"

namespace ridgecast::triangulation {

// The star of v counter-clockwise: border_[i].from is a link vertex, border_[i].outer lies beyond the edge from -> to. False when the
// star or its ring leaves the write set.
bool Triangulation::collectStar(VertexId v, WriteSet& set) const {
  auto& border = set.border_;
  border.clear();
  set.hole_.clear();
  const HalfEdge first = edgeOf(v);
  for (HalfEdge h = first;;) {
    const TriangleId t = h >> 2;
    if (!set.allows(triangles_.regionOf(t))) return false;
    assert(origin(h) == v);
    const HalfEdge opposite = next(h), outer = twin(opposite);
    if (!set.allows(triangles_.regionOf(outer >> 2))) return false;
    set.hole_.push_back(t);
    border.push_back({origin(opposite), origin(next(opposite)), outer, kOutside});
    h = twin(previous(h));
    if (h == first) return true;
  }
}

// Fills the polygon border_[0..n).from; new triangles in fill_, corners as indices, a < b < c, (c, a) the base.
void Triangulation::fillStar(WriteSet& set) const {
  const auto& border = set.border_;
  const auto count = static_cast<std::uint32_t>(border.size());
  set.fill_.clear();
  set.spans_.clear();
  set.spans_.emplace_back(0, count - 1);
  const auto point = [&](std::uint32_t i) { return vertexRecords_[border[i].from].point(); };
  while (!set.spans_.empty()) {
    const auto [i, j] = set.spans_.back();
    set.spans_.pop_back();
    const VertexId a = border[i].from, c = border[j].from;
    const bool finiteBase = a != kInfinite && c != kInfinite;
    std::uint32_t best = j, infinite = j;
    for (std::uint32_t m = i + 1; m < j; ++m) {
      const VertexId b = border[m].from;
      if (b == kInfinite) {
        infinite = m;
        continue;
      }
      if (finiteBase && orientation(point(i), point(m), point(j)) <= 0) continue;
      if (best == j || encloses(a, border[best].from, c, b)) best = m;
    }
    if (best == j) best = infinite;  // nothing to the left of the base: it is a hull edge now
    assert(best != j);
    set.fill_.push_back({i, best, j, regionOfCorners(a, border[best].from, c), kNoEdge});
    if (best - i > 1) set.spans_.emplace_back(i, best);
    if (j - best > 1) set.spans_.emplace_back(best, j);
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
  for (TriangleId t : set.hole_) triangles_.release(t);
  for (auto& f : set.fill_) {
    f.id = triangles_.allocate(f.region);
    triangleRecords_[f.id] = {{border[f.a].from, border[f.b].from, border[f.c].from}, {kNoEdge, kNoEdge, kNoEdge}};
    setEdge(border[f.a].from, 4 * f.id);
    setEdge(border[f.b].from, 4 * f.id + 1);
    setEdge(border[f.c].from, 4 * f.id + 2);
  }
  const auto count = static_cast<std::uint32_t>(border.size());
  for (std::size_t n = 0; n < set.fill_.size(); ++n) {
    const auto& f = set.fill_[n];
    if (f.b - f.a == 1) link(4 * f.id, border[f.a].outer);
    if (f.c - f.b == 1) link(4 * f.id + 1, border[f.b].outer);
    if (n == 0) {
      link(4 * f.id + 2, border[count - 1].outer);
      continue;
    }
    // The triangle whose side is this one's base came earlier.
    for (std::size_t m = n; m-- > 0;) {
      const auto& g = set.fill_[m];
      if (g.a == f.a && g.b == f.c) {
        link(4 * f.id + 2, 4 * g.id);
        break;
      }
      if (g.b == f.a && g.c == f.c) {
        link(4 * f.id + 2, 4 * g.id + 1);
        break;
      }
    }
  }
  vertices_.release(v);
  return Change::kDone;
}

}  // namespace ridgecast::triangulation
