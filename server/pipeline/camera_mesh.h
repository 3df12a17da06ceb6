#pragma once
// A camera's mesh with its leaves: the quadtree, the triangulation filed by it, and what refinement keeps beside. It keeps these laws:
//   - every leaf of the tree is valid (holds its grid) when follow() returns;
//   - the mesh's vertices are the grids of its leaves and what refinement added inside leaves; outside all leaves only grid points;
//   - a vertex's height is the terrain's, snapped to a level that is at most one above that of the leaf that holds it: one level is
//     not seen (0.15 px), and splits and merges then move no vertex;
//   - coordinates are relative to an anchor and stay below 2^26.
// One thread; generate, change and evaluate spread over the pool inside.

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/terrain/terrain.h"
#include "server/quadtree/quadtree.h"
#include "server/refinement/candidates.h"
#include "server/refinement/coarsening.h"
#include "server/refinement/screening.h"
#include "server/scheduling/pool.h"
#include "server/triangulation/triangulation.h"

namespace ridgecast::pipeline {

struct alignas(64) Leaf {  // every iteration looks at the first two lines of all of them, and at the rest of few
  lattice::LeafAddress address;
  triangulation::RegionId region = triangulation::kOutside;
  refinement::HeightRange ground;  // that was seen there

  // of the current iteration
  double removalLimit = 0;  // pixels of loss below which vertices go
  std::vector<refinement::Pending> pending;
  std::vector<triangulation::VertexId> removable;
  std::uint32_t inserted = 0, removed = 0;
  bool visible = false;
  std::vector<refinement::Pending> deferred;
  std::vector<triangulation::Point2> insertedPoints, removedPoints;  // when recording

  std::vector<triangulation::RegionId> writeSet;  // its own region and those of the leaves that touch it
  std::uint64_t version = 0, hash = 0;
};

struct Follow {
  bool changed = false;
  bool anew = false;  // nothing of the mesh there was remains
  std::uint32_t generated = 0, dropped = 0;  // leaves
};

class CameraMesh : private triangulation::Partition {
 public:
  CameraMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, refinement::Metric metric);

  // select: which leaves there are. Call generate() next.
  Follow follow(const camera::Pose& pose);
  // generate: re-files what the tree re-drew, drops what is gone, inserts the grids that are missing.
  void generate(scheduling::Pool& pool);

  const std::vector<Leaf*>& leaves() const { return ordered_; }  // canonical order of address
  Leaf* leaf(lattice::LeafAddress address) const;                // null: not a leaf

  // Applies every leaf's `removable` (those whose loss is below `removalLimit`) and `pending`, then chooses candidates for what is fresh in it; in
  // parallel where write sets are disjoint, with the result of doing it leaf by leaf in order of (colour, address). Returns how many changes were
  // deferred to the serial step. What it and later neighbours left fresh is evaluate()'s.
  std::uint32_t change(const refinement::View& view, scheduling::Pool& pool);

  // Brings the records of leaves closer together where removals have scattered them; only those of leaves that takeChanged() told of.
  void compact();
  // f(k) for the leaves in leaves() whose triangles changed since the last call.
  template <class F>
  void takeChanged(F&& f) {
    for (std::size_t k = 0; k < regions_.size(); ++k) {
      if (!mesh_.takeChanged(regions_[k])) continue;
      if (mesh_.sparse(regions_[k])) sparse_.push_back(regions_[k]);
      f(k);
    }
  }

  // Chooses candidates for every fresh triangle. `view`: of the last screening, if there was one since generate().
  void evaluate(scheduling::Pool& pool, const refinement::View* view = nullptr);

  // Chooses the candidates of all leaves that may be seen once more, as this view sees them.
  void chooseAgain(const refinement::View& view, scheduling::Pool& pool);

  // Whether every leaf's grid is in the mesh, and exactly the grids' points are kept from removal; empty when so. Slow.
  std::string verifyGrids() const;

  triangulation::Triangulation& triangulation() { return mesh_; }
  const triangulation::Triangulation& triangulation() const { return mesh_; }
  const refinement::Surface& surface() const { return surface_; }
  refinement::Surface& surface() { return surface_; }
  const triangulation::Partition& partition() const { return *this; }
  void record(bool on) { recording_ = on; }
  std::uint64_t heights() const { return heights_.load(std::memory_order_relaxed); }
  std::size_t memoryBytes() const;
  double groundBelow(const camera::Pose& pose) const;

 private:
  triangulation::Moves keepBeside(std::vector<triangulation::VertexId>* moved);
  triangulation::RegionId regionAt(triangulation::Point2 p) const override;
  triangulation::Point2 local(lattice::Point p) const;
  int levelAt(triangulation::Point2 p) const;
  void anchorAt(const camera::Pose& pose, bool keep);
  // A leaf that is no longer one, and who has its ground now: one that it was merged into, or those that it was split into, or nobody.
  struct Former {
    std::unique_ptr<Leaf> leaf;
    Leaf* whole = nullptr;
    std::vector<Leaf*> parts;
  };
  void replaceOrdered(const std::vector<Leaf*>& made, const std::vector<Former>& former);
  void refile(const std::vector<Former>& former, scheduling::Pool& pool);
  void snapVertices(const std::vector<triangulation::VertexId>& vertices);
  void insertGrids(const std::vector<Leaf*>& made, const std::vector<Former>& former);
  void updateWriteSets(const std::vector<Leaf*>& made, const std::vector<Former>& former, scheduling::Pool& pool);
  void setStays(triangulation::VertexId v, bool stays);  // a grid point, or no longer
  void dropOutside();
  void addCurvature(const std::vector<triangulation::VertexId>& vertices);
  void changeLeaf(Leaf& leaf, const refinement::View& view);
  void evaluateLeaf(Leaf& leaf, const refinement::View* view);
  // Notes what is kept beside a vertex just inserted; `fineY` steps.
  std::uint64_t mixedOf(triangulation::VertexId v) const;
  void note(triangulation::VertexId v, std::int32_t fineY, int level, float loss);
  bool insertOne(Leaf& leaf, const refinement::Pending& p, const refinement::View& view, triangulation::WriteSet& set);

  std::shared_ptr<const terrain::Terrain> terrain_;
  refinement::Metric metric_;
  quadtree::Quadtree tree_;
  triangulation::Triangulation mesh_;
  refinement::Surface surface_;
  std::vector<std::unique_ptr<Leaf>> leaves_;  // by region; null: unused
  std::vector<Leaf*> ordered_;
  std::vector<triangulation::RegionId> regions_;  // of the leaves in ordered_
  std::vector<triangulation::RegionId> sparse_;   // to be compacted next time; some may be gone
  bool pendingGenerate_ = false;
  bool recording_ = false;
  std::atomic<std::uint64_t> heights_{0};
};

}  // namespace ridgecast::pipeline
