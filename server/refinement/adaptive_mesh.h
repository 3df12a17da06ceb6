#pragma once
// A triangulation that follows the terrain: the triangles, a candidate for each, and what removing each vertex would cost. The only place
// that changes them, so that they always match. Generation decides which regions exist, and when; the pipeline decides the views.
//
// A triangle's *candidate* is the point of the true terrain that would improve the mesh most there, chosen once, when the triangle is new
// (candidates.cpp). A vertex's *loss* is the error that its removal would make (coarsening.cpp). *Fixed* vertices are never removed.
//
// Positions are in steps relative to anchor(), heights in steps, absolute. Arrays grow resident with the mesh.
//
// Threads: calls marked "one region" touch only records of that region, so that different regions may be processed concurrently; with a
// write set, those of its regions. Everything else: one thread, alone.

#include <atomic>
#include <memory>
#include <span>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/refinement/colour_error.h"
#include "server/refinement/records.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

struct GridPoint {
  lattice::Point at;  // absolute
  std::int32_t y;     // the terrain's height
};

struct ListedCandidate {
  triangulation::Point2 point;
  std::int32_t y;  // steps: the terrain's height there
  float pixels;    // between it and the mesh, as kPixels measures, whatever the metric

  // The worst first; a total order that depends on values only.
  friend bool operator<(const ListedCandidate& a, const ListedCandidate& b) {
    if (a.pixels != b.pixels) return a.pixels > b.pixels;
    return triangulation::smaller(a.point, b.point);
  }
};
// Keeps the worst `most`, sorted.
void keepWorst(std::vector<ListedCandidate>& candidates, std::size_t most);

class AdaptiveMesh {
 public:
  using RegionId = triangulation::RegionId;
  using VertexId = triangulation::VertexId;
  using TriangleId = triangulation::TriangleId;

  // The level to which vertices outside all regions are snapped.
  static constexpr int kOutsideLevel = 8;

  // `triangles`: the capacity. The partition answers relative to anchor(). `colourError`: the bound of ColourError; 0: off.
  AdaptiveMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, Metric metric,
               const triangulation::Partition& partition, double colourError = 0);

  // ---- the anchor: absolute steps ----
  lattice::Point anchor() const { return anchor_; }
  void setAnchor(lattice::Point anchor);  // everything stays where it is in the world
  triangulation::Point2 local(lattice::Point p) const {
    return {static_cast<std::int32_t>(p.x - anchor_.x), static_cast<std::int32_t>(p.z - anchor_.z)};
  }
  lattice::Point absolute(triangulation::Point2 p) const { return {anchor_.x + p.x, anchor_.z + p.z}; }

  // ---- regions ----
  RegionId addRegion(const triangulation::Square& square, int level);
  void removeRegion(RegionId region) { mesh_.removeRegion(region); }  // must be empty
  void clear() { mesh_.clear(); }                                     // regions stay
  const HeightRange& ground(RegionId region) const { return regions_[region].ground; }
  void prefetch(RegionId region) const { __builtin_prefetch(&regions_[region], 1); }
  void addGround(RegionId region, const HeightRange& seen) { regions_[region].ground.add(seen); }
  // As those of the triangulation. What is kept beside the records follows them.
  void adopt(RegionId from, RegionId to) { mesh_.adopt(from, to); }
  bool split(std::span<const RegionId> regions, const triangulation::Triangulation::Loop& loop);
  void refile(RegionId region, std::vector<VertexId>& moved);  // appends the vertices that moved, by their new ids
  void compact(RegionId region);
  bool takeChanged(RegionId region) { return mesh_.takeChanged(region); }
  // Appends the region's vertices that are new, or have another height, since they were taken. One region.
  void takeFreshVertices(RegionId region, std::vector<VertexId>& out);

  // ---- fixed vertices ----
  std::vector<std::int32_t> heightsAt(std::span<const lattice::Point> points);  // of the terrain; points absolute
  // Starts an empty mesh.
  void start(const GridPoint& a, const GridPoint& b, const GridPoint& c);
  // Inserts points as fixed vertices, or fixes the vertices that are there. `hint`: a triangle to walk from; becomes one near the last
  // point.
  void insertGrid(std::span<const GridPoint> points, TriangleId& hint);
  bool isFixed(VertexId v) const { return std::isinf(extras_[v].loss); }
  void setFixed(VertexId v, bool fixed);  // one region
  void drop(VertexId v);                  // fixed or not
  // Snaps a vertex to the level of the region that holds it, where it is more than one level off.
  void snap(VertexId v);

  // ---- other ground ----
  // Sets the terrain, which differs from the previous one within these areas. Call for each region that may hold a part of them, first
  // raiseVertices(), then refreshTriangles(): vertices take their new heights, triangles new candidates with the next evaluateFresh().
  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed);
  void raiseVertices(RegionId region);     // one region
  void refreshTriangles(RegionId region);  // one region

  // ---- refinement ----
  // Finds in each region, if it `isSeen`, the candidates at or above the threshold, and the vertices whose remembered loss is below
  // `removalLimit`, into `work`, which is empty and stays untouched if there is nothing to do. A wanted candidate is found once: a caller
  // that does not insert it must postpone() it. Takes several regions at a time, to prefetch what the next ones read.
  struct Search {
    RegionId region;
    bool isSeen;
    double removalLimit;  // pixels
    Work* work;
  };
  // Returns a bit for each search, of at most 32, that found work.
  std::uint32_t findWork(std::span<const Search> searches, const View& view, double threshold);
  // The candidate will be found again. Returns what is seen of its error. `pageAnew`: the dormant ones of its page are judged again, too.
  // One region.
  double postpone(const Pending& wanted, RegionId region, const View& view, bool pageAnew);
  // Removes those removable vertices whose loss still is below the limit. By write set.
  void removeUnneeded(RegionId region, const View& view, triangulation::WriteSet& set, Work& work);
  // Inserts what is pending; the rest is in work.deferred. By write set.
  void insertWanted(RegionId region, const View& view, triangulation::WriteSet& set, Work& work);
  // Call shortly before both: prefetches what they read first.
  void prefetch(const Work& work) const {
    for (const Pending& wanted : work.pending) mesh_.prefetch(wanted.triangle);
    for (VertexId v : work.removable) mesh_.prefetchVertex(v);  // not read: others may write it meanwhile
  }
  void insertDeferred(RegionId region, const View& view, Work& work);
  // Chooses the candidates of the region's fresh triangles, and hashes them. `view`: of the last findWork(); without it, all pages with
  // fresh triangles are checked next time. One region.
  void evaluateFresh(RegionId region, const View* view);
  // The same for all of the region's triangles.
  void evaluateAll(RegionId region, const View& view);

  // ---- reading ----
  const triangulation::Triangulation& triangulation() const { return mesh_; }
  Candidate candidate(TriangleId t) const {
    const Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots;
    return {{four.x[k], four.z[k]}, four.y[k], four.error[k]};
  }
  PageCandidates candidatesOf(std::uint32_t page) const {
    PageCandidates blocks;
    for (std::uint32_t k = 0; k < blocks.size(); ++k) {
      const std::uint32_t block = mesh_.trianglePages().blockOf(page, k);
      blocks[k] =
          block == triangulation::kNoSlot ? nullptr : &candidates_[block * triangulation::TrianglePages::kBlock / Candidates::kSlots];
    }
    return blocks;
  }
  const PageScreen& screen(std::uint32_t page) const { return screens_[page]; }
  const NextCheck& nextCheck(std::uint32_t page) const { return checks_[page]; }
  const NextCheck& nextRegionCheck(RegionId region) const { return regions_[region].nextCheck; }
  const VertexExtra& extra(VertexId v) const { return extras_[v]; }
  // The region's hash (common/mesh). One region: sums again what changed.
  std::uint64_t hash(RegionId region);
  // The region as a leaf's mesh in canonical order. Any thread.
  ridgecast::mesh::LeafMesh extract(RegionId region, lattice::LeafAddress leaf) const;
  // Appends the candidates whose triangle, or the ground over it, the view's wide frustum may see, in any order, without the dormant ones.
  // Any thread.
  void list(RegionId region, const View& view, std::vector<ListedCandidate>& out) const;
  std::size_t memoryBytes() const;
  std::uint64_t heights() const { return heights_.load(std::memory_order_relaxed); }  // evaluated so far

 private:
  using Mask = triangulation::TrianglePages::Mask;

  // storage and changes: adaptive_mesh.cpp
  lattice::Area boxOf(TriangleId t) const;
  int levelAt(triangulation::Point2 p) const { return regions_[partition_.regionAt(p)].level; }
  triangulation::Vertex vertexAt(const GridPoint& p) const;
  triangulation::Moves moves(std::vector<VertexId>* moved);
  void moveTriangles(std::span<const triangulation::Move> moves);
  void moveVertices(std::span<const triangulation::Move> moves);
  void setHeight(VertexId v, std::int32_t y) {
    mesh_.setHeight(v, y);
    mesh_.vertexPages().setFresh(v);
  }
  void keepExtra(VertexId v, std::int32_t fineY, int level, float loss);
  void addCurvature(std::span<const VertexId> vertices);
  bool insertOne(const Pending& wanted, RegionId region, const View& view, triangulation::WriteSet& set, Work& work);
  // The candidate of a new triangle. The page's bounds do not know it yet.
  void setCandidate(TriangleId t, const Candidate& c) {
    Candidates& four = candidates_[t / Candidates::kSlots];
    const std::uint32_t k = t % Candidates::kSlots;
    four.x[k] = c.point.x;
    four.z[k] = c.point.z;
    four.y[k] = c.y;
    four.error[k] = c.error;
    PageScreen& screen = screens_[mesh_.trianglePages().pageOf(t)];
    const Mask others = ~(Mask{1} << mesh_.trianglePages().indexOf(t));
    screen.dormant &= others;
    screen.blank &= others;
  }
  // The triangle's term; what the slot held before leaves the page's sum.
  void setHash(TriangleId t, std::uint64_t term) {
    PageScreen& page = screens_[mesh_.trianglePages().pageOf(t)];
    const std::uint32_t k = mesh_.trianglePages().indexOf(t);
    page.hash += term - (hashes_[t] & -(page.hashed >> k & 1));  // a branch would be unpredictable
    page.hashed |= Mask{1} << k;
    hashes_[t] = term;
  }
  // The page of a candidate or a vertex is checked next time, whatever is known of it.
  void wakeCandidate(TriangleId t, RegionId region) {
    const std::uint32_t page = mesh_.trianglePages().pageOf(t);
    screens_[page].travel = -1;
    checks_[page].travel = regions_[region].nextCheck.travel = kAlways;
  }
  void wakeVertex(VertexId v, RegionId region) {
    PageLosses& page = losses_[mesh_.vertexPages().pageOf(v)];
    page.travel = -1;
    page.nextCheck = regions_[region].nextLossCheck = kAlways;
  }

  // candidates.cpp
  struct Scratch;
  void takeFresh(RegionId region, const View* view, Scratch& scratch);
  void readBatch(std::size_t begin, std::size_t count, Scratch& scratch);
  void tryPoints(std::size_t begin, std::size_t count, int bits, const View* closely, Scratch& scratch) const;
  void tryChanged(std::uint32_t slot, int bits, Scratch& scratch) const;
  void tryThesisPoint(std::uint32_t slot, int bits, Scratch& scratch) const;
  void judgeTrials(int level, const View* closely, Scratch& scratch);
  void judgeColours(int level, Scratch& scratch);
  void storeCandidates(RegionId region, const View* view, Scratch& scratch);
  void beginScreen(std::uint32_t page, double travel);
  void prefetchCandidate(TriangleId t) const { __builtin_prefetch(&candidates_[t / Candidates::kSlots], 1); }
  // What evaluateFresh() will write of a new triangle.
  void prefetchEvaluation(TriangleId t) const {
    prefetchCandidate(t);
    __builtin_prefetch(&hashes_[t], 1);
    __builtin_prefetch(&screens_[mesh_.trianglePages().pageOf(t)], 1);
  }
  float& errorOf(TriangleId t) { return candidates_[t / Candidates::kSlots].error[t % Candidates::kSlots]; }
  void prefetchRecords(std::size_t k, const Scratch& scratch) const;
  void prefetchCorners(std::size_t k, const Scratch& scratch) const;

  // screening.cpp
  using PageList = std::vector<std::uint32_t>;
  void prefetchCandidates(std::uint32_t page) const;
  void screenPixels(RegionId region, const PageList& due, const View& view, double threshold, std::vector<Pending>& out);
  void screenThesis(RegionId region, const View& view, double threshold, std::vector<Pending>& out) const;
  void collectDue(RegionId region, const View& view, double skipped, PageList& due);
  void checkPage(std::uint32_t page, const View& view, double threshold, std::vector<TriangleId>& wanted);
  void wakeDormant(std::uint32_t page);
  void blankDead(std::uint32_t page, Mask alive);
  void judgeWanted(const std::vector<TriangleId>& wanted, const View& view, std::vector<Pending>& out);

  // coarsening.cpp
  void prefetchVertices(std::uint32_t page) const;
  void collectDueLosses(RegionId region, const View& view, double removalLimit, PageList& due);
  void findRemovable(RegionId region, const PageList& due, const View& view, Work& work);
  void checkLosses(std::uint32_t page, const View& view, double slope, std::vector<VertexId>& out);
  void foldLoss(const triangulation::Vertex& p, VertexId v, float loss, RegionId region, const View& view);
  float lossOf(VertexId v, const Measure& measure, triangulation::WriteSet& set) const;
  double colourLoss(VertexId v, const Measure& measure, const triangulation::WriteSet& set) const;

  triangulation::Triangulation mesh_;
  const triangulation::Partition& partition_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  Metric metric_;
  ColourError colour_;
  std::vector<lattice::Area> changed_;  // where the terrain differs from the one before
  lattice::Point anchor_;

  triangulation::Records<Candidates> candidates_;  // by four triangles
  triangulation::Records<NextCheck> checks_;       // by page of triangles
  triangulation::Records<PageScreen> screens_;     // by page of triangles
  triangulation::Records<std::uint64_t> hashes_;   // by triangle: its term of its leaf's hash (common/mesh)
  triangulation::Records<PageLosses> losses_;      // by page of vertices
  triangulation::Records<VertexExtra> extras_;     // by vertex
  triangulation::Records<float> curvature_;        // by vertex, metres; of no length but for kThesis
  std::vector<RegionState> regions_;               // by region; as long as the largest id needs
  std::atomic<std::uint64_t> heights_{0};
  triangulation::WriteSet everything_;
};

}  // namespace ridgecast::refinement
