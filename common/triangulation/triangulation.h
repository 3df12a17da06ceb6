#pragma once
// An incremental Delaunay triangulation of points on an integer lattice, filed by regions. Knows no terrain and no camera.
//
// The mesh is a function of its point set alone (see predicates.h): neither order, nor threads, nor compiler matter. It covers the
// convex hull; beyond the hull lies one symbolic vertex at infinity, kInfinite, so that hull edges need no special case.
//
// Topology   triangle t has corners v[0..2], counter-clockwise seen from above, and half-edges 4t + k, k = 0..2, from v[k] to
//            v[k + 1]; twin[k] is the half-edge that runs back in the neighbour:
//
//                 v[2]
//                 /  \          half-edge 4t + 0 runs v[0] -> v[1], its twin runs v[1] -> v[0]
//              2 /    \ 1
//               /  t   \        a ghost triangle has kInfinite as one corner; its other two are a hull edge, seen from outside
//            v[0] ---- v[1]
//                  0
//
// Regions    half-open squares that do not overlap; kOutside is everything else. A triangle is filed under the region that holds its
//            centroid (exactly), a vertex under the region that holds it; ghosts are filed outside. Records are kept in pages of
//            one region, so that work on a region stays in few cache lines, and pages of emptied regions are reused.
// Partition  the owner of the regions answers `regionAt`; when its answers change, call refile().
//
// Threads    insert() and remove() with a WriteSet touch only records of the regions in it: calls with disjoint sets may run at the
//            same time. A change that would leave its set writes nothing and returns kDeferred. Everything else: one thread, alone.
//            Where vertices are shared between regions, only their `edge` (any half-edge that starts there) is written by two
//            threads, atomically and relaxed: whichever is last is right.
//
// Sources    Bowyer (1981), Watson (1981) for the cavity; Devillers (1999) and CGAL's documentation for removal by filling the star.

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/outcome/contract.h"
#include "common/triangulation/predicates.h"
#include "common/triangulation/storage.h"

namespace ridgecast::triangulation {

using VertexId = std::uint32_t;
using TriangleId = std::uint32_t;
using HalfEdge = std::uint32_t;

inline constexpr VertexId kInfinite = 0;
inline constexpr HalfEdge kNoEdge = 0xffffffffu;

struct Vertex {
  std::int32_t x, z;  // steps relative to the anchor, |.| < 2^26
  std::int32_t y;     // carried along, never judged
  HalfEdge edge;      // some half-edge that starts here; read with edgeOf(): an insertion beside it may write it meanwhile
  Point2 point() const { return {x, z}; }
};

struct Triangle {
  VertexId v[3];
  HalfEdge twin[3];
};

enum class Change {
  kDone,
  kDeferred,   // would touch a region outside the write set; nothing was written
  kDuplicate,  // insert: a vertex is there already; nothing was written
  kFull,       // no storage left; nothing was written
  kRefused,    // remove: the remaining points would all be collinear; nothing was written
};

// The half-open square that a region covers, in steps relative to the anchor.
struct Square {
  std::int32_t x = 0, z = 0, side = 0;
};

// Which region holds a point, in steps relative to the anchor. Must answer kOutside where no region is.
class Partition {
 public:
  virtual ~Partition() = default;
  virtual RegionId regionAt(Point2 p) const = 0;
};

// What one thread needs to change the mesh: the regions it may write and scratch memory. Not shared between threads.
class WriteSet {
 public:
  WriteSet() = default;
  void allowAll() { all_ = true; }
  void allow(std::span<const RegionId> regions);
  bool allows(RegionId r) const { return all_ || (r < stamp_.size() && stamp_[r] == current_); }

  // The last plan: the triangles of the star, and f(a, b, c) for the corners of each triangle that would fill it.
  const std::vector<TriangleId>& star() const { return cavity_; }
  template <class F>
  void forEachFill(F&& f) const {
    for (const Fill& t : fill_) f(boundary_[t.a].from, boundary_[t.b].from, boundary_[t.c].from);
  }
  // The triangles that filled it when it was applied, in the same order.
  template <class F>
  void forEachFilled(F&& f) const {
    for (const Fill& t : fill_) f(t.id);
  }

 private:
  friend class Triangulation;
  bool all_ = false;
  std::uint32_t current_ = 0;
  std::vector<std::uint32_t> stamp_;
  struct Spot {   // a point as seen from the one that comes or goes
    double x, z;  // steps, exact
    double lift;  // x x + z z, exact; NaN where a coordinate is too large for that, so that no filter decides
  };
  struct OpenEdge {  // an edge of the cavity so far, cavity on its left, that may still be opened
    HalfEdge outer;  // the half-edge that runs back, outside the cavity
    VertexId from, to;
    Spot a, b;  // of from and to
  };
  struct BoundaryEdge {  // an edge of the cavity that stays
    VertexId from, to;
    HalfEdge outer;
    RegionId region;  // of the new triangle (insertion)
  };
  struct Fill {             // a triangle of a removal's plan
    std::uint32_t a, b, c;  // indices into boundary_ (their `from`)
    RegionId region;
    TriangleId id;
    std::uint32_t parent;  // 4 * the fill across the base (c, a) + its side
  };
  struct Span {
    std::uint32_t from, to, parent;
  };
  std::vector<TriangleId> cavity_;
  std::vector<BoundaryEdge> boundary_;
  std::vector<OpenEdge> open_ = std::vector<OpenEdge>(64);
  std::vector<Point2> link_;  // of the star that is filled
  std::vector<Fill> fill_;
  std::vector<Span> spans_;
};

// Called for every record whose id changes in refile(), split() or compact(); those of a call come to one region, page by page.
struct Moves {
  std::function<void(std::span<const Move>)> triangles, vertices;
};

class Triangulation {
 public:
  // Room for `triangles` live triangles, scattered as they may be over at most 4,096 regions that are compacted when sparse (more
  // virtual memory than that is reserved; only what is used becomes resident).
  Triangulation(std::uint32_t triangles, const Partition& partition);

  // ---- regions ----
  // Adds an empty region. Its square must match the partition's answers; it saves asking.
  RegionId addRegion(const Square& square);
  void removeRegion(RegionId region);  // must be empty
  std::uint32_t regionLimit() const { return static_cast<std::uint32_t>(triangles_.regionLimit()); }
  // Refiles what is filed under `from` under `to`, whose square holds that of `from`. Nothing moves.
  void adopt(RegionId from, RegionId to) {
    expects(squares_[from].side <= squares_[to].side, "a region adopts one that it covers");
    triangles_.adopt(from, to);
    vertices_.adopt(from, to);
  }
  // Refiles everything in `region` by the partition's answers.
  void refile(RegionId region, const Moves& moves = {});
  // The same for several regions whose squares others now cover, of which none covers two; they are empty afterwards. `loop` calls body(k)
  // for every k < count, on any number of threads; what comes to one region is told by only one of them. False, and nothing was done, if
  // storage may not suffice to hold everything twice for a while.
  using Loop = std::function<void(std::size_t count, const std::function<void(std::size_t)>& body)>;
  bool split(std::span<const RegionId> regions, const Loop& loop, const Moves& moves = {});
  // Moves the records of a region closer together where they lie scattered over too many pages: where it is sparse.
  bool sparse(RegionId region) const { return triangles_.sparse(region) || vertices_.sparse(region); }
  void compact(RegionId region, const Moves& moves = {});
  std::uint32_t triangleCount(RegionId region) const { return triangles_.count(region); }
  std::uint32_t vertexCount(RegionId region) const { return vertices_.count(region); }
  // Whether triangles or vertices of the region changed since the last takeChanged().
  bool changed(RegionId region) const { return triangles_.changed(region) || vertices_.changed(region); }
  bool takeChanged(RegionId region);
  void markChanged(RegionId region) { triangles_.markChanged(region); }

  // ---- points ----
  // Removes everything and starts from three points that are not collinear. Regions stay.
  void start(const Vertex& a, const Vertex& b, const Vertex& c);
  void clear();
  bool empty() const { return edgeOf(kInfinite) == kNoEdge; }

  // Inserts a point that lies in the closed triangle `at` (or, outside the hull, beyond the hull edge of the ghost `at`).
  Change insert(const Vertex& p, TriangleId at, WriteSet& set, VertexId* made = nullptr);
  // Prefetch, for callers that know which triangles come next: the record; and, once that is there, what it names.
  void prefetch(TriangleId t) const { __builtin_prefetch(&triangleRecords_[t]); }
  void prefetchVertex(VertexId v) const { __builtin_prefetch(&vertexRecords_[v]); }
  void prefetchCorners(TriangleId t) const {
    for (VertexId v : triangleRecords_[t].v) __builtin_prefetch(&vertexRecords_[v]);
  }
  void prefetchVertices(std::uint32_t block) const {
    static_assert(VertexPages::kBlock * sizeof(Vertex) == 128);
    __builtin_prefetch(&vertexRecords_[block * VertexPages::kBlock]);
    __builtin_prefetch(&vertexRecords_[block * VertexPages::kBlock + VertexPages::kBlock / 2]);
  }
  void prefetchTriangles(std::uint32_t block) const {
    const char* const first = reinterpret_cast<const char*>(&triangleRecords_[block * TrianglePages::kBlock]);
    for (std::size_t k = 0; k < TrianglePages::kBlock * sizeof(Triangle); k += 64) __builtin_prefetch(first + k);
  }
  void prefetchNeighbours(TriangleId t) const {
    for (HalfEdge h : triangleRecords_[t].twin) __builtin_prefetch(&triangleRecords_[h >> 2]);
  }
  // Removal in two steps: plan() fills the cavity that v would leave, writing nothing but the set's scratch (kDone: there is a plan);
  // the plan can be looked at, and applied as long as nothing changed in between. remove() is both.
  Change plan(VertexId v, WriteSet& set) const;
  Change apply(VertexId v, WriteSet& set);
  Change remove(VertexId v, WriteSet& set) {
    const Change planned = plan(v, set);
    return planned == Change::kDone ? apply(v, set) : planned;
  }
  // The triangle that holds p (a ghost when p is outside the hull), walking from `from`. kNoEdge when the walk leaves the write set.
  TriangleId locate(Point2 p, TriangleId from, const WriteSet& set) const;
  TriangleId anyTriangle() const;

  // The caller must mark the triangles around it.
  void setHeight(VertexId v, std::int32_t y) {
    vertexRecords_[v].y = y;
    vertices_.markChanged(vertices_.regionOf(v));
  }
  // Moves the anchor: every coordinate changes by the same amount.
  void translate(std::int32_t dx, std::int32_t dz);

  // ---- reading ----
  const Vertex& vertex(VertexId v) const { return vertexRecords_[v]; }
  const Triangle& triangle(TriangleId t) const { return triangleRecords_[t]; }
  VertexId origin(HalfEdge h) const { return triangleRecords_[h >> 2].v[h & 3]; }
  HalfEdge twin(HalfEdge h) const { return triangleRecords_[h >> 2].twin[h & 3]; }
  // The next and the previous of three corners: small tables in a register, because a branch here is taken one time in three,
  // unpredictably.
  static constexpr unsigned after(unsigned k) { return (0b00'10'01u >> 2 * k) & 3; }
  static constexpr unsigned before(unsigned k) { return (0b01'00'10u >> 2 * k) & 3; }
  static constexpr HalfEdge next(HalfEdge h) { return (h & ~3u) | after(h & 3); }
  static constexpr HalfEdge previous(HalfEdge h) { return (h & ~3u) | before(h & 3); }
  // f(h) for every half-edge that starts at v, counter-clockwise.
  template <class F>
  void forEachAround(VertexId v, F&& f) const {
    const HalfEdge first = edgeOf(v);
    std::uint32_t left = triangles_.capacity();
    for (HalfEdge h = first;; --left) {
      expects(left > 0, "a walk around a vertex ends where it began");
      f(h);
      h = twin(previous(h));
      if (h == first) return;
    }
  }
  bool isGhost(TriangleId t) const {
    const Triangle& r = triangleRecords_[t];
    return r.v[0] == kInfinite || r.v[1] == kInfinite || r.v[2] == kInfinite;
  }
  RegionId regionOf(TriangleId t) const { return triangles_.regionOf(t); }
  RegionId regionOfVertex(VertexId v) const { return vertices_.regionOf(v); }
  HalfEdge edgeOf(VertexId v) const { return __atomic_load_n(&vertexRecords_[v].edge, __ATOMIC_RELAXED); }
  std::uint32_t liveTriangles() const;                                 // without ghosts
  std::uint32_t liveVertices() const { return vertices_.live() - 1; }  // without infinity
  std::uint32_t triangleCapacity() const { return triangles_.capacity(); }
  std::uint32_t vertexCapacity() const { return vertices_.capacity(); }
  std::size_t residentBytes() const;  // of the blocks in use

  const TrianglePages& trianglePages() const { return triangles_; }
  TrianglePages& trianglePages() { return triangles_; }
  const VertexPages& vertexPages() const { return vertices_; }
  VertexPages& vertexPages() { return vertices_; }

 private:
  void setEdge(VertexId v, HalfEdge h) { __atomic_store_n(&vertexRecords_[v].edge, h, __ATOMIC_RELAXED); }
  bool conflicts(const Triangle& t, const Point2& p) const;  // the triangle's circle holds p
  bool ghostContains(const Triangle& t, const Point2& p) const;
  // The region of a triangle; `guess` is looked at first.
  RegionId regionOfCorners(VertexId a, VertexId b, VertexId c, RegionId guess) const;
  RegionId regionOfSum(std::int32_t x3, std::int32_t z3, RegionId guess) const {
    const Square& s = squares_[guess];
    const auto width = static_cast<std::uint32_t>(3 * s.side);
    if (static_cast<std::uint32_t>(x3 - 3 * s.x) < width && static_cast<std::uint32_t>(z3 - 3 * s.z) < width) return guess;
    return askRegion(x3, z3);
  }
  RegionId askRegion(std::int32_t x3, std::int32_t z3) const;
  void link(HalfEdge a, HalfEdge b) {
    triangleRecords_[a >> 2].twin[a & 3] = b;
    triangleRecords_[b >> 2].twin[b & 3] = a;
  }
  // The record at `from` is copied to `to` and everything that points to it follows.
  void moveTriangle(TriangleId from, TriangleId to);
  void moveVertex(VertexId from, VertexId to);
  // The last two loops of split(), for what goes to one region; `splitting`: by region, whether it is split.
  void joinCopies(std::span<const Move> triangles, const std::vector<std::uint8_t>& splitting);
  void joinStars(std::span<const Move> vertices, const std::vector<std::uint8_t>& splitting);
  // The cavity that p makes, and its boundary, into the set's scratch; false when it leaves the set.
  bool findCavity(const Vertex& p, TriangleId at, RegionId home, WriteSet& set) const;
  // Keeps the cavity's slots in `home`, mostly all, for new triangles there; releases the others. Returns how many are kept.
  std::size_t emptyCavity(RegionId home, WriteSet& set) {
    triangles_.markChanged(home);
    std::size_t spare = 0;
    for (TriangleId t : set.cavity_) {
      if (triangles_.regionOf(t) == home)
        set.cavity_[spare++] = t;
      else
        triangles_.release(t);
    }
    return spare;
  }
  TriangleId takeSlot(RegionId region, RegionId home, WriteSet& set, std::size_t& spare) {
    if (region != home || spare == 0) return triangles_.allocate(region);
    const TriangleId t = set.cavity_[--spare];
    triangles_.renew(t);
    return t;
  }
  bool collectStar(VertexId v, WriteSet& set) const;
  void fillStar(WriteSet& set) const;
  bool opens(const WriteSet::OpenEdge& edge, const Triangle& beyond, unsigned apex, const Point2& p, WriteSet::Spot& spot) const;

  const Partition* partition_;
  TrianglePages triangles_;
  VertexPages vertices_;
  std::vector<Square> squares_;  // by region; no side: kOutside or unused
  Records<Triangle> triangleRecords_;
  Records<Vertex> vertexRecords_;
};

}  // namespace ridgecast::triangulation
