// Storage of the mesh, location, and insertion by the hole of Bowyer and Watson.
#include "server/triangulation/triangulation.h"

#include <algorithm>
#include <cassert>

namespace ridgecast::triangulation {

int inCircleExact(const Point2& a, const Point2& b, const Point2& c, const Point2& d) {
  // |differences| < 2^27, so lifted < 2^55, cross products < 2^55 and the sum < 2^112.
  using Wide = __int128;
  const std::int64_t ap = std::int64_t{a.z} - d.z, aq = std::int64_t{a.x} - d.x, bp = std::int64_t{b.z} - d.z, bq = std::int64_t{b.x} - d.x,
                     cp = std::int64_t{c.z} - d.z, cq = std::int64_t{c.x} - d.x;
  const Wide det = Wide{ap * ap + aq * aq} * (bp * cq - cp * bq) + Wide{bp * bp + bq * bq} * (cp * aq - ap * cq) +
                   Wide{cp * cp + cq * cq} * (ap * bq - bp * aq);
  return det > 0 ? 1 : det < 0 ? -1 : 0;
}

void WriteSet::allow(std::span<const RegionId> regions) {
  all_ = false;
  ++current_;
  for (RegionId r : regions) {
    if (r >= stamp_.size()) stamp_.resize(r + 64, 0);
    stamp_[r] = current_;
  }
}

// A live set of n points has about 2n triangles; ghosts, and pages that are not full, need room too.
Triangulation::Triangulation(std::uint32_t triangles, const Partition& partition)
    : partition_(&partition),
      triangles_(2 * triangles + 4096 * Pages::kSlots),
      vertices_(triangles + 4096 * Pages::kSlots),
      triangleRecords_(std::make_unique_for_overwrite<Triangle[]>(triangles_.capacity())),
      vertexRecords_(std::make_unique_for_overwrite<Vertex[]>(vertices_.capacity())) {
  static_assert(sizeof(Triangle) == 24 && sizeof(Vertex) == 16);
  clear();
}

void Triangulation::clear() {
  triangles_.clear();
  vertices_.clear();
  const VertexId infinite = vertices_.allocate(kOutside);  // the first slot there is
  assert(infinite == kInfinite);
  vertexRecords_[infinite] = Vertex{};
}

RegionId Triangulation::addRegion() {
  const RegionId t = triangles_.addRegion(), v = vertices_.addRegion();
  assert(t == v);
  (void)v;
  return t;
}

void Triangulation::removeRegion(RegionId region) {
  triangles_.removeRegion(region);
  vertices_.removeRegion(region);
}

bool Triangulation::takeChanged(RegionId region) {
  const bool changed = triangles_.changed(region);
  triangles_.clearChanged(region);
  return changed;
}

std::uint32_t Triangulation::liveTriangles() const {
  std::uint32_t ghosts = 0;
  triangles_.forEach(kOutside, [&](TriangleId t) { ghosts += isGhost(t); });
  return triangles_.live() - ghosts;
}

std::size_t Triangulation::residentBytes() const {
  return std::size_t{Pages::kSlots} * (triangles_.pagesInUse() * sizeof(Triangle) + vertices_.pagesInUse() * sizeof(Vertex));
}

RegionId Triangulation::regionOfCorners(VertexId a, VertexId b, VertexId c) const {
  if (a == kInfinite || b == kInfinite || c == kInfinite) return kOutside;
  const Vertex &p = vertexRecords_[a], &q = vertexRecords_[b], &r = vertexRecords_[c];
  // The centroid lies in a square with integer bounds exactly when its floor does.
  const auto third = [](std::int32_t sum) { return sum >= 0 ? sum / 3 : -((2 - sum) / 3); };
  return partition_->regionAt({third(p.x + q.x + r.x), third(p.z + q.z + r.z)});
}

void Triangulation::start(const Vertex& a, const Vertex& b, const Vertex& c) {
  clear();
  Vertex corners[3] = {a, b, c};
  const std::int64_t turn = orientation(a.point(), b.point(), c.point());
  assert(turn != 0);
  if (turn < 0) std::swap(corners[1], corners[2]);
  VertexId v[3];
  for (int k = 0; k < 3; ++k) {
    v[k] = vertices_.allocate(partition_->regionAt(corners[k].point()));
    vertexRecords_[v[k]] = corners[k];
  }
  const TriangleId inner = triangles_.allocate(regionOfCorners(v[0], v[1], v[2]));
  triangleRecords_[inner] = {{v[0], v[1], v[2]}, {}};
  TriangleId ghosts[3];
  for (int k = 0; k < 3; ++k) {
    ghosts[k] = triangles_.allocate(kOutside);
    triangleRecords_[ghosts[k]] = {{v[(k + 1) % 3], v[k], kInfinite}, {}};
    link(4 * inner + k, 4 * ghosts[k]);
    vertexRecords_[v[k]].edge = 4 * inner + k;
  }
  for (int k = 0; k < 3; ++k) link(4 * ghosts[k] + 1, 4 * ghosts[(k + 2) % 3] + 2);
  vertexRecords_[kInfinite].edge = 4 * ghosts[0] + 2;
}

bool Triangulation::encloses(VertexId a, VertexId b, VertexId c, VertexId d) const {
  if (d == kInfinite) return false;
  // A ghost encloses what is strictly beyond its hull edge, and the open edge itself.
  const auto ghost = [&](VertexId u, VertexId w) {
    const Point2 pu = vertexRecords_[u].point(), pw = vertexRecords_[w].point(), pd = vertexRecords_[d].point();
    const std::int64_t side = orientation(pu, pw, pd);
    return side > 0 || (side == 0 && strictlyBetween(pu, pw, pd));
  };
  if (a == kInfinite) return ghost(b, c);
  if (b == kInfinite) return ghost(c, a);
  if (c == kInfinite) return ghost(a, b);
  return inCircle(vertexRecords_[a].point(), vertexRecords_[b].point(), vertexRecords_[c].point(), vertexRecords_[d].point());
}

bool Triangulation::holeContains(const Triangle& t, const Point2& p) const {
  for (int k = 0; k < 3; ++k) {
    if (t.v[k] != kInfinite) continue;
    const Point2 u = vertexRecords_[t.v[(k + 1) % 3]].point(), w = vertexRecords_[t.v[(k + 2) % 3]].point();
    const std::int64_t side = orientation(u, w, p);
    return side > 0 || (side == 0 && strictlyBetween(u, w, p));
  }
  return inCircle(vertexRecords_[t.v[0]].point(), vertexRecords_[t.v[1]].point(), vertexRecords_[t.v[2]].point(), p);
}

Change Triangulation::insert(const Vertex& p, TriangleId at, WriteSet& set, VertexId* made) {
  const Point2 point = p.point();
  if (!set.allows(triangles_.regionOf(at))) return Change::kDeferred;
  const Triangle& start = triangleRecords_[at];
  for (VertexId v : start.v)
    if (v != kInfinite && vertexRecords_[v].point() == point) return Change::kDuplicate;
  assert(holeContains(start, point));

  // Walk outwards from the first triangle, turning right at every closed door: the hole's border comes out counter-clockwise. The
  // hole has no vertex inside, so its dual is a tree and nothing is met twice.
  auto& hole = set.hole_;
  auto& border = set.border_;
  auto& stack = set.stack_;
  hole.clear();
  border.clear();
  stack.clear();
  hole.push_back(at);
  for (int k = 2; k >= 0; --k) stack.push_back(start.twin[k]);
  while (!stack.empty()) {
    const HalfEdge h = stack.back();
    stack.pop_back();
    const TriangleId t = h >> 2;
    if (!set.allows(triangles_.regionOf(t))) return Change::kDeferred;
    const Triangle& r = triangleRecords_[t];
    const unsigned k = h & 3, k1 = k == 2 ? 0 : k + 1, k2 = k == 0 ? 2 : k - 1;
    if (holeContains(r, point)) {
      hole.push_back(t);
      stack.push_back(r.twin[k2]);
      stack.push_back(r.twin[k1]);
    } else {
      border.push_back({r.v[k1], r.v[k], h, kOutside});
    }
  }
  const RegionId home = triangles_.regionOf(at);
  for (auto& b : border) {
    if (b.from == kInfinite || b.to == kInfinite) {
      b.region = kOutside;
    } else {
      const Vertex &q = vertexRecords_[b.from], &r = vertexRecords_[b.to];
      const auto third = [](std::int32_t sum) { return sum >= 0 ? sum / 3 : -((2 - sum) / 3); };
      b.region = partition_->regionAt({third(p.x + q.x + r.x), third(p.z + q.z + r.z)});
    }
    if (b.region != home && !set.allows(b.region)) return Change::kDeferred;
  }
  const RegionId vertexRegion = partition_->regionAt(point);
  if (!set.allows(vertexRegion)) return Change::kDeferred;
  if (!triangles_.hasFree(64 + static_cast<std::uint32_t>(border.size())) || !vertices_.hasFree(64)) return Change::kFull;

  const VertexId v = vertices_.allocate(vertexRegion);
  for (TriangleId t : hole) triangles_.release(t);
  HalfEdge first = kNoEdge, last = kNoEdge;
  for (const auto& b : border) {
    const TriangleId t = triangles_.allocate(b.region);
    Triangle& r = triangleRecords_[t];
    r.v[0] = v;
    r.v[1] = b.from;
    r.v[2] = b.to;
    link(4 * t + 1, b.outer);
    if (last != kNoEdge) link(last, 4 * t);
    else first = 4 * t;
    last = 4 * t + 2;
    setEdge(b.from, 4 * t + 1);
  }
  link(last, first);
  vertexRecords_[v] = p;
  setEdge(v, first);
  if (made) *made = v;
  return Change::kDone;
}

TriangleId Triangulation::locate(Point2 p, TriangleId from, const WriteSet& set) const {
  TriangleId t = from;
  if (isGhost(t)) {  // step into the hull
    const Triangle& r = triangleRecords_[t];
    if (holeContains(r, p)) {
      const int k = r.v[0] == kInfinite ? 1 : r.v[1] == kInfinite ? 2 : 0;
      if (orientation(vertexRecords_[r.v[k]].point(), vertexRecords_[r.v[(k + 1) % 3]].point(), p) > 0) return t;
    }
    const int k = r.v[0] == kInfinite ? 1 : r.v[1] == kInfinite ? 2 : 0;
    t = r.twin[k] >> 2;
  }
  // The visibility walk ends on every Delaunay triangulation (De Floriani et al. 1991).
  for (;;) {
    if (!set.allows(triangles_.regionOf(t))) return kNoEdge;
    if (isGhost(t)) return t;
    const Triangle& r = triangleRecords_[t];
    TriangleId onward = kNoEdge;
    for (int k = 0; k < 3 && onward == kNoEdge; ++k)
      if (orientation(vertexRecords_[r.v[k]].point(), vertexRecords_[r.v[(k + 1) % 3]].point(), p) < 0) onward = r.twin[k] >> 2;
    if (onward == kNoEdge) return t;
    t = onward;
  }
}

TriangleId Triangulation::anyTriangle() const { return vertexRecords_[kInfinite].edge >> 2; }

void Triangulation::refile(RegionId region, const Moves& moves) {
  std::vector<TriangleId> triangles;
  triangles.reserve(triangles_.count(region));
  triangles_.forEach(region, [&](TriangleId t) { triangles.push_back(t); });
  for (TriangleId t : triangles) {
    const Triangle old = triangleRecords_[t];
    const RegionId home = regionOfCorners(old.v[0], old.v[1], old.v[2]);
    if (home == region) continue;
    const TriangleId moved = triangles_.allocate(home);
    if (moved == kNoSlot) throw std::bad_alloc();
    if (!triangles_.fresh(t)) triangles_.clearFresh(moved);
    triangleRecords_[moved] = old;
    for (unsigned k = 0; k < 3; ++k) {
      HalfEdge twin = old.twin[k];
      triangleRecords_[twin >> 2].twin[twin & 3] = 4 * moved + k;
      if (edgeOf(old.v[k]) == 4 * t + k) setEdge(old.v[k], 4 * moved + k);
    }
    triangles_.release(t);
    if (moves.triangle) moves.triangle(t, moved);
  }
  std::vector<VertexId> vertices;
  vertices.reserve(vertices_.count(region));
  vertices_.forEach(region, [&](VertexId v) {
    if (v != kInfinite) vertices.push_back(v);
  });
  for (VertexId v : vertices) {
    const RegionId home = partition_->regionAt(vertexRecords_[v].point());
    if (home == region) continue;
    const VertexId moved = vertices_.allocate(home);
    if (moved == kNoSlot) throw std::bad_alloc();
    vertexRecords_[moved] = vertexRecords_[v];
    const HalfEdge first = edgeOf(v);
    for (HalfEdge h = first;;) {
      triangleRecords_[h >> 2].v[h & 3] = moved;
      h = twin(previous(h));
      if (h == first) break;
    }
    vertices_.release(v);
    if (moves.vertex) moves.vertex(v, moved);
  }
}

void Triangulation::translate(std::int32_t dx, std::int32_t dz) {
  for (RegionId region = 0; region < regionLimit(); ++region) {
    if (!vertices_.hasRegion(region)) continue;
    vertices_.forEach(region, [&](VertexId v) {
      if (v == kInfinite) return;
      vertexRecords_[v].x += dx;
      vertexRecords_[v].z += dz;
    });
  }
}

}  // namespace ridgecast::triangulation
