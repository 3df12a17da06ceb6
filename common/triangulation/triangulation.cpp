// Storage of the mesh, location, and insertion by the cavity of Bowyer and Watson.
#include "common/triangulation/triangulation.h"

#include <bit>
#include <cassert>
#include <cmath>
#include <limits>

#include "common/outcome/contract.h"

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

namespace {
// Differences of two coordinates then have 27 bits, as the predicates need.
bool isInReach(const Vertex& p) {
  constexpr std::int32_t kReach = 1 << 26;
  return p.x > -kReach && p.x < kReach && p.z > -kReach && p.z < kReach;
}
}  // namespace

// A live set of n points has about 2n triangles; ghosts, and pages that are not full, need room too.
Triangulation::Triangulation(std::uint32_t triangles, const Partition& partition)
    : partition_(&partition),
      triangles_(2 * triangles + 8192 * TrianglePages::kSlots),
      vertices_(triangles + 8192 * VertexPages::kSlots),
      squares_(1),
      triangleRecords_(triangles_.capacity()),
      vertexRecords_(vertices_.capacity()) {
  static_assert(sizeof(Triangle) == 24 && sizeof(Vertex) == 16);
  expects(triangles < 1u << 29, "half-edges have 32 bits");
  clear();
}

void Triangulation::clear() {
  triangles_.clear();
  vertices_.clear();
  const VertexId infinite = vertices_.allocate(kOutside);  // the first slot there is
  expects(infinite == kInfinite, "infinity has the first slot");
  vertexRecords_[infinite] = {0, 0, 0, kNoEdge};
}

RegionId Triangulation::addRegion(const Square& square) {
  expects(square.side > 0, "a region covers something");
  const RegionId t = triangles_.addRegion(), v = vertices_.addRegion();
  expects(t == v, "triangles and vertices have the same regions");
  if (t >= squares_.size()) squares_.resize(t + 1);
  squares_[t] = square;
  return t;
}

void Triangulation::removeRegion(RegionId region) {
  triangles_.removeRegion(region);
  vertices_.removeRegion(region);
  squares_[region] = {};
}

bool Triangulation::takeChanged(RegionId region) {
  const bool is = changed(region);
  triangles_.clearChanged(region);
  vertices_.clearChanged(region);
  return is;
}

std::uint32_t Triangulation::liveTriangles() const {
  std::uint32_t ghosts = 0;
  triangles_.forEach(kOutside, [&](TriangleId t) { ghosts += isGhost(t); });
  return triangles_.live() - ghosts;
}

std::size_t Triangulation::residentBytes() const {
  return std::size_t{TrianglePages::kBlock} * triangles_.blocksInUse() * sizeof(Triangle) +
         std::size_t{VertexPages::kBlock} * vertices_.blocksInUse() * sizeof(Vertex);
}

RegionId Triangulation::askRegion(std::int32_t x3, std::int32_t z3) const {
  // The centroid lies in a square with integer bounds exactly when its floor does.
  const auto third = [](std::int32_t sum) { return sum >= 0 ? sum / 3 : -((2 - sum) / 3); };
  return partition_->regionAt({third(x3), third(z3)});
}

RegionId Triangulation::regionOfCorners(VertexId a, VertexId b, VertexId c, RegionId guess) const {
  if (a == kInfinite || b == kInfinite || c == kInfinite) return kOutside;
  const Vertex &p = vertexRecords_[a], &q = vertexRecords_[b], &r = vertexRecords_[c];
  return regionOfSum(p.x + q.x + r.x, p.z + q.z + r.z, guess);
}

void Triangulation::start(const Vertex& a, const Vertex& b, const Vertex& c) {
  clear();
  Vertex corners[3] = {a, b, c};
  const std::int64_t turn = orientation(a.point(), b.point(), c.point());
  expects(turn != 0, "a mesh begins with a triangle, not with a line");
  if (turn < 0) std::swap(corners[1], corners[2]);
  VertexId v[3];
  for (int k = 0; k < 3; ++k) {
    expects(isInReach(corners[k]), "coordinates are less than 2^26 steps from the anchor");
    v[k] = vertices_.allocate(partition_->regionAt(corners[k].point()));
    vertexRecords_[v[k]] = corners[k];
  }
  const TriangleId inner = triangles_.allocate(regionOfCorners(v[0], v[1], v[2], kOutside));
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

// A ghost's circle is the half plane strictly beyond its hull edge, and the open edge itself.
bool Triangulation::ghostContains(const Triangle& t, const Point2& p) const {
  const int k = t.v[0] == kInfinite ? 1 : t.v[1] == kInfinite ? 2 : 0;
  const Point2 u = vertexRecords_[t.v[k]].point(), w = vertexRecords_[t.v[k == 2 ? 0 : k + 1]].point();
  const std::int64_t side = orientation(u, w, p);
  return side > 0 || (side == 0 && strictlyBetween(u, w, p));
}

inline bool Triangulation::conflicts(const Triangle& t, const Point2& p) const {
  if ((t.v[0] == kInfinite) | (t.v[1] == kInfinite) | (t.v[2] == kInfinite)) return ghostContains(t, p);
  return inCircle(vertexRecords_[t.v[0]].point(), vertexRecords_[t.v[1]].point(), vertexRecords_[t.v[2]].point(), p);
}

namespace {

// Spots are exact while coordinates are below this.
constexpr std::int32_t kExact = 1 << 25;

template <class Spot>
inline Spot spotOf(const Vertex& v, const Point2& p) {
  const std::int32_t x = v.x - p.x, z = v.z - p.z;
  const bool exact = (static_cast<std::uint32_t>(x + kExact) < 2u * kExact) & (static_cast<std::uint32_t>(z + kExact) < 2u * kExact);
  const double dx = x, dz = z;
  return {dx, dz, exact ? dx * dx + dz * dz : std::numeric_limits<double>::quiet_NaN()};
}

}  // namespace

// Whether the circle of the triangle beyond an edge holds p. `spot` becomes the apex's.
//
// In-circle relative to p: lift(A) (B x C) + lift(B) (C x A) + lift(C) (A x B) for A, B, C counter-clockwise. Lifts and cross products are
// exact, so only three products and two sums round: at most 3 x 2^-53 of the sum of magnitudes, and a little.
inline bool Triangulation::opens(const WriteSet::OpenEdge& edge, const Triangle& beyond, unsigned apex, const Point2& p,
                                 WriteSet::Spot& spot) const {
  const VertexId c = beyond.v[apex];
  if ((c == kInfinite) | (edge.from == kInfinite) | (edge.to == kInfinite)) {
    if (c != kInfinite) spot = spotOf<WriteSet::Spot>(vertexRecords_[c], p);
    return ghostContains(beyond, p);
  }
  spot = spotOf<WriteSet::Spot>(vertexRecords_[c], p);
  const WriteSet::Spot &A = edge.b, &B = edge.a, &C = spot;
  const double u = A.lift * (B.z * C.x - B.x * C.z), v = B.lift * (C.z * A.x - C.x * A.z), w = C.lift * (A.z * B.x - A.x * B.z);
  const double det = u + v + w, bound = 4.5e-16 * (std::abs(u) + std::abs(v) + std::abs(w));
  if (det > bound) return true;
  if (det < -bound) return false;
  return inCircle(vertexRecords_[edge.to].point(), vertexRecords_[edge.from].point(), vertexRecords_[c].point(), p);
}

// Walks outwards from the first triangle, turning right at every edge that is not opened: the boundary comes out counter-clockwise. The
// cavity has no vertex inside, so its dual is a tree and nothing is met twice.
inline bool Triangulation::findCavity(const Vertex& p, TriangleId at, RegionId home, WriteSet& set) const {
  const Point2 point = p.point();
  const Triangle& start = triangleRecords_[at];
  auto& open = set.open_;
  set.cavity_.assign(1, at);
  set.boundary_.clear();
  WriteSet::Spot corner[3];
  for (HalfEdge h : start.twin) __builtin_prefetch(&vertexRecords_[triangleRecords_[h >> 2].v[before(h & 3)]]);
  for (int k = 0; k < 3; ++k) corner[k] = spotOf<WriteSet::Spot>(vertexRecords_[start.v[k]], point);
  // The edge at hand is kept out of the stack, where it would be read back just after it was written.
  std::size_t top = 0;
  WriteSet::OpenEdge edge{start.twin[0], start.v[0], start.v[1], corner[0], corner[1]};
  open[top++] = {start.twin[2], start.v[2], start.v[0], corner[2], corner[0]};
  open[top++] = {start.twin[1], start.v[1], start.v[2], corner[1], corner[2]};
  for (;;) {
    const TriangleId t = edge.outer >> 2;
    const RegionId region = triangles_.regionOf(t);
    if (region != home && !set.allows(region)) return false;
    const Triangle& r = triangleRecords_[t];
    const unsigned k1 = after(edge.outer & 3), k2 = before(edge.outer & 3);
    WriteSet::Spot apex{};
    if (opens(edge, r, k2, point, apex)) {
      expects(set.cavity_.size() < triangles_.capacity(), "a cavity meets no triangle twice");
      set.cavity_.push_back(t);
      if (top == open.size()) open.resize(2 * open.size());
      __builtin_prefetch(&triangleRecords_[r.twin[k1] >> 2]);
      __builtin_prefetch(&triangleRecords_[r.twin[k2] >> 2]);
      open[top++] = {r.twin[k2], r.v[k2], edge.to, apex, edge.b};
      edge.outer = r.twin[k1];
      edge.to = r.v[k2];
      edge.b = apex;
      continue;
    }
    RegionId filed = kOutside;
    if ((edge.from != kInfinite) & (edge.to != kInfinite))
      filed = regionOfSum(3 * p.x + static_cast<std::int32_t>(edge.a.x + edge.b.x),
                          3 * p.z + static_cast<std::int32_t>(edge.a.z + edge.b.z), home);
    if (filed != home && !set.allows(filed)) return false;
    set.boundary_.push_back({edge.from, edge.to, edge.outer, filed});
    if (top == 0) return true;
    edge = open[--top];
  }
}

Change Triangulation::insert(const Vertex& p, TriangleId at, WriteSet& set, VertexId* made) {
  const RegionId home = triangles_.regionOf(at);
  if (!set.allows(home)) return Change::kDeferred;
  assert(triangles_.alive(at));
  expects(isInReach(p), "coordinates are less than 2^26 steps from the anchor");
  const Triangle& start = triangleRecords_[at];
  for (HalfEdge h : start.twin) __builtin_prefetch(&triangleRecords_[h >> 2]);
  for (VertexId v : start.v)
    if (v != kInfinite && vertexRecords_[v].point() == p.point()) return Change::kDuplicate;
  assert(conflicts(start, p.point()));
  if (!findCavity(p, at, home, set)) return Change::kDeferred;
  const RegionId vertexRegion = regionOfSum(3 * p.x, 3 * p.z, home);
  if (!set.allows(vertexRegion)) return Change::kDeferred;
  if (!triangles_.hasFree(64 + static_cast<std::uint32_t>(set.boundary_.size())) || !vertices_.hasFree(64)) return Change::kFull;

  const VertexId v = vertices_.allocate(vertexRegion);
  std::size_t spare = emptyCavity(home, set);
  HalfEdge first = kNoEdge, last = kNoEdge;
  for (const auto& b : set.boundary_) {
    const TriangleId t = takeSlot(b.region, home, set, spare);
    Triangle& r = triangleRecords_[t];
    r.v[0] = v;
    r.v[1] = b.from;
    r.v[2] = b.to;
    link(4 * t + 1, b.outer);
    if (last != kNoEdge)
      link(last, 4 * t);
    else
      first = 4 * t;
    last = 4 * t + 2;
    setEdge(b.from, 4 * t + 1);
  }
  while (spare > 0) triangles_.release(set.cavity_[--spare]);
  link(last, first);
  vertexRecords_[v] = p;
  setEdge(v, first);
  if (made) *made = v;
  return Change::kDone;
}

TriangleId Triangulation::locate(Point2 p, TriangleId from, const WriteSet& set) const {
  assert(triangles_.alive(from));
  TriangleId t = from;
  if (isGhost(t)) {  // step into the hull
    const Triangle& r = triangleRecords_[t];
    if (conflicts(r, p)) {
      const int k = r.v[0] == kInfinite ? 1 : r.v[1] == kInfinite ? 2 : 0;
      if (orientation(vertexRecords_[r.v[k]].point(), vertexRecords_[r.v[(k + 1) % 3]].point(), p) > 0) return t;
    }
    const int k = r.v[0] == kInfinite ? 1 : r.v[1] == kInfinite ? 2 : 0;
    t = r.twin[k] >> 2;
  }
  // The visibility walk ends on every Delaunay triangulation (De Floriani et al. 1991).
  unsigned entry = 3;  // the side it came in by: the point is beyond it
  for (std::uint32_t left = triangles_.capacity();; --left) {
    expects(left > 0, "a walk meets no triangle twice");
    if (!set.all_ && !set.allows(triangles_.regionOf(t))) return kNoEdge;
    const Triangle& r = triangleRecords_[t];
    if (isGhost(t)) return t;
    unsigned beyond = 0;  // bit k: p is to the right of side k
    for (unsigned k = 0; k < 3; ++k)
      beyond |= static_cast<unsigned>(orientation(vertexRecords_[r.v[k]].point(), vertexRecords_[r.v[after(k)]].point(), p) < 0) << k;
    beyond &= ~(1u << entry);
    if (beyond == 0) return t;
    const HalfEdge onward = r.twin[std::countr_zero(beyond)];
    t = onward >> 2;
    entry = onward & 3;
  }
}

TriangleId Triangulation::anyTriangle() const { return vertexRecords_[kInfinite].edge >> 2; }

void Triangulation::moveTriangle(TriangleId from, TriangleId to) {
  const Triangle record = triangleRecords_[from];
  triangleRecords_[to] = record;
  for (unsigned k = 0; k < 3; ++k) {
    triangleRecords_[record.twin[k] >> 2].twin[record.twin[k] & 3] = 4 * to + k;
    if (edgeOf(record.v[k]) == 4 * from + k) setEdge(record.v[k], 4 * to + k);
  }
}

void Triangulation::moveVertex(VertexId from, VertexId to) {
  vertexRecords_[to] = vertexRecords_[from];
  forEachAround(from, [&](HalfEdge h) { triangleRecords_[h >> 2].v[h & 3] = to; });
}

void Triangulation::refile(RegionId region, const Moves& moves) {
  expects(triangles_.hasRegion(region), "what is filed anew is that of a region that is there");
  std::vector<TriangleId> triangles;
  triangles.reserve(triangles_.count(region));
  triangles_.forEach(region, [&](TriangleId t) { triangles.push_back(t); });
  RegionId home = kOutside;  // of the last one, a good guess for the next
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    if (k + 8 < triangles.size()) prefetchCorners(triangles[k + 8]);
    if (k + 4 < triangles.size()) prefetchNeighbours(triangles[k + 4]);
    const TriangleId t = triangles[k];
    const Triangle& r = triangleRecords_[t];
    home = regionOfCorners(r.v[0], r.v[1], r.v[2], home);
    if (home == region) continue;
    const TriangleId to = triangles_.allocate(home);
    if (to == kNoSlot) throw std::bad_alloc();
    if (!triangles_.fresh(t)) triangles_.clearFresh(to);
    moveTriangle(t, to);
    triangles_.release(t);
    if (moves.triangles) moves.triangles({{Move{t, to}}});
  }
  std::vector<VertexId> vertices;
  vertices.reserve(vertices_.count(region));
  vertices_.forEach(region, [&](VertexId v) {
    if (v != kInfinite) vertices.push_back(v);
  });
  for (VertexId v : vertices) {
    const Vertex& p = vertexRecords_[v];
    home = regionOfSum(3 * p.x, 3 * p.z, home);
    if (home == region) continue;
    const VertexId to = vertices_.allocate(home);
    if (to == kNoSlot) throw std::bad_alloc();
    if (!vertices_.fresh(v)) vertices_.clearFresh(to);
    moveVertex(v, to);
    vertices_.release(v);
    if (moves.vertices) moves.vertices({{Move{v, to}}});
  }
}

void Triangulation::compact(RegionId region, const Moves& moves) {
  if (triangles_.sparse(region))
    triangles_.compact(region, [&](TriangleId from, TriangleId to) {
      moveTriangle(from, to);
      if (moves.triangles) moves.triangles({{Move{from, to}}});
    });
  if (region != kOutside && vertices_.sparse(region))  // infinity stays where it is
    vertices_.compact(region, [&](VertexId from, VertexId to) {
      moveVertex(from, to);
      if (moves.vertices) moves.vertices({{Move{from, to}}});
    });
}

void Triangulation::translate(std::int32_t dx, std::int32_t dz) {
  for (RegionId region = 0; region < regionLimit(); ++region) {
    if (!vertices_.hasRegion(region)) continue;
    squares_[region].x += dx;
    squares_[region].z += dz;
    vertices_.forEach(region, [&](VertexId v) {
      if (v == kInfinite) return;
      vertexRecords_[v].x += dx;
      vertexRecords_[v].z += dz;
      expects(isInReach(vertexRecords_[v]), "an anchor lies near its mesh");
    });
  }
}

}  // namespace ridgecast::triangulation
