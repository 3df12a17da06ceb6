#pragma once
// A triangulation that follows the terrain: the triangles, a candidate for each, and what removing each vertex would cost. The only place
// that changes them, so that they always match. Generation decides which regions exist, and when; the pipeline decides the views.
//
// A triangle's *candidate* is the point of the true terrain that would improve the mesh most there, chosen once, when the triangle is new
// (chooser.h, candidate_store.h). A vertex's *loss* is the error that its removal would make (loss_store.h). *Fixed* vertices are never
// removed.
//
// Positions are in steps relative to anchor(), heights in steps, absolute. Arrays grow resident with the mesh.
//
// Threads: calls marked "one region" touch only records of that region, so that different regions may be processed concurrently; with a
// write set, those of its regions. Everything else: one thread, alone.

#include <memory>
#include <span>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/refinement/candidate_store.h"
#include "server/refinement/chooser.h"
#include "server/refinement/loss_store.h"
#include "server/refinement/records.h"
#include "server/refinement/stored_vertex.h"
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
  // Of the terrain; points absolute.
  std::vector<std::int32_t> heightsAt(std::span<const lattice::Point> points) { return chooser_.heightsAt(points); }
  // Starts an empty mesh.
  void start(const GridPoint& a, const GridPoint& b, const GridPoint& c);
  // Inserts points as fixed vertices, or fixes the vertices that are there. `hint`: a triangle to walk from; becomes one near the last
  // point.
  void insertGrid(std::span<const GridPoint> points, TriangleId& hint);
  bool isFixed(VertexId v) const { return losses_.isFixed(v); }
  void setFixed(VertexId v, bool fixed) { losses_.setFixed(v, fixed, stateOf(v)); }  // one region
  void drop(VertexId v);                                                             // fixed or not
  // Appends the region's vertices, ascending by x, then z. One region.
  void store(RegionId region, std::vector<StoredVertex>& out) const;
  // Fills an empty mesh that has its regions; `fixed` has one for each vertex. What is not fixed is looked at by the next findWork().
  // False: they are all on one line, two are the same, or they are too many, too far away or out of range; then the mesh is of no use.
  bool restore(std::span<const StoredVertex> vertices, const std::vector<bool>& fixed);
  // Snaps a vertex to the level of the region that holds it, where it is more than one level off.
  void snap(VertexId v);

  // ---- other ground ----
  // Sets the terrain, which differs from the previous one within these areas. Call for each region that may hold a part of them, first
  // raiseVertices(), then refreshTriangles(): vertices take their new heights, triangles new candidates with the next evaluateFresh().
  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) {
    chooser_.setTerrain(std::move(terrain), changed);
  }
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
  Candidate candidate(TriangleId t) const { return candidates_.at(t); }
  const CandidateStore& candidates() const { return candidates_; }
  const NextCheck& nextRegionCheck(RegionId region) const { return regions_[region].nextCheck; }
  const VertexExtra& extra(VertexId v) const { return losses_.at(v); }
  // The region's hash (common/mesh). One region: sums again what changed.
  std::uint64_t hash(RegionId region) { return candidates_.hash(region); }
  // The region as a leaf's mesh in canonical order. Any thread.
  ridgecast::mesh::LeafMesh extract(RegionId region, lattice::LeafAddress leaf) const;
  // Appends the candidates whose triangle, or the ground over it, the view's wide frustum may see, in any order, without the dormant ones.
  // Any thread.
  void list(RegionId region, const View& view, std::vector<ListedCandidate>& out) const;
  std::size_t memoryBytes() const { return mesh_.residentBytes() + candidates_.memoryBytes() + losses_.memoryBytes(); }
  std::uint64_t heights() const { return chooser_.heights(); }  // evaluated so far

 private:
  int levelAt(triangulation::Point2 p) const { return regions_[partition_.regionAt(p)].level; }
  RegionState& stateOf(VertexId v) { return regions_[mesh_.regionOfVertex(v)]; }
  triangulation::Vertex vertexAt(const GridPoint& p) const;
  triangulation::Vertex vertexAt(const StoredVertex& p) const;
  bool startFrom(std::span<const StoredVertex> vertices);
  triangulation::Moves moves(std::vector<VertexId>* moved);
  void setHeight(VertexId v, std::int32_t y) {
    mesh_.setHeight(v, y);
    mesh_.vertexPages().setFresh(v);
  }
  bool insertOne(const Pending& wanted, RegionId region, const View& view, triangulation::WriteSet& set, Work& work);
  float lossOf(VertexId v, const Measure& measure, triangulation::WriteSet& set) const;
  double colourLoss(VertexId v, const Measure& measure, const triangulation::WriteSet& set) const;

  triangulation::Triangulation mesh_;
  const triangulation::Partition& partition_;
  Metric metric_;
  lattice::Point anchor_;
  CandidateStore candidates_;
  LossStore losses_;
  Chooser chooser_;
  std::vector<RegionState> regions_;  // by region; as long as the largest id needs
  triangulation::WriteSet everything_;
};

}  // namespace ridgecast::refinement
