#pragma once
// A camera's leaves over its mesh: select (the quadtree follows the camera) and generate (the mesh follows the quadtree). Invariants:
//   - the mesh's vertices are the grids of its leaves and what refinement added inside leaves; outside all leaves only grid points;
//   - a vertex's height is the terrain's, snapped to a level that is at most one above that of the leaf that holds it: one level is
//     not seen (0.15 px), and splits and merges then move no vertex;
//   - coordinates are relative to an anchor and stay below 2^26.
// One thread; generate and compact spread over the pool inside.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/quadtree/quadtree.h"
#include "server/refinement/adaptive_mesh.h"
#include "server/scheduling/pool.h"

namespace ridgecast::generation {

struct alignas(64) Leaf {  // an iteration reads only those that change; for all leaves it reads CameraMesh's lists
  lattice::LeafAddress address;
  triangulation::RegionId region = triangulation::kOutside;
  refinement::Work work{};                        // of the current iteration
  std::vector<triangulation::RegionId> writeSet;  // its own region and those of the leaves that touch it
  std::uint64_t version = 0, points = 0, hash = 0;
};

struct Selection {
  bool changed = false;
  bool fromNothing = false;                  // nothing of the previous mesh remains
  std::uint32_t generated = 0, dropped = 0;  // leaves
};

class CameraMesh final : public triangulation::Partition {
 public:
  CameraMesh(std::shared_ptr<const terrain::Terrain> terrain, std::uint32_t triangles, refinement::Metric metric, double colourError = 0);

  // Selects the leaves; `ground`: height of the ground below the camera in metres. Call generate() next.
  Selection select(const camera::Pose& pose, double ground);
  // Re-files what lies in leaves that split or merged, drops what is gone, inserts missing grids, and compacts the records of leaves that
  // removals have scattered.
  void generate(scheduling::Pool& pool);

  // The vertices: by leaf in canonical order, then those outside by their square of AdaptiveMesh::kOutsideLevel; in each ascending by x,
  // then z.
  std::vector<refinement::StoredVertex> vertices() const;
  // A mesh that has selected no leaves yet becomes that of these leaves, in canonical order, and vertices, in the order of vertices();
  // select() goes on from it. False: no camera's mesh has these; then this one is of no use.
  bool restore(const std::vector<lattice::LeafAddress>& leaves, std::span<const refinement::StoredVertex> vertices, scheduling::Pool& pool);

  // New ground, which differs within these areas.
  void setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed, scheduling::Pool& pool);

  // In canonical order of address, and two lists beside it.
  const std::vector<Leaf*>& leaves() const { return ordered_; }
  const std::vector<lattice::LeafAddress>& addresses() const { return addresses_; }
  const std::vector<triangulation::RegionId>& regions() const { return regions_; }
  Leaf* leaf(lattice::LeafAddress address) const;  // null: not a leaf
  // f(k) for the leaves in leaves() whose triangles or vertices changed since the last takeChanged().
  template <class F>
  void forEachChanged(F&& f) const {
    for (std::size_t k = 0; k < regions_.size(); ++k)
      if (mesh_.triangulation().changed(regions_[k])) f(k);
  }
  struct Changed {
    std::size_t leaf;  // in leaves()
    bool points;       // its vertices did, too
  };
  std::vector<Changed> takeChanged();
  bool takeChangedOutside() { return mesh_.takeChanged(triangulation::kOutside); }  // the same, of what lies outside all leaves

  refinement::AdaptiveMesh& mesh() { return mesh_; }
  const refinement::AdaptiveMesh& mesh() const { return mesh_; }
  std::size_t memoryBytes() const { return mesh_.memoryBytes() + leaves_.size() * sizeof(Leaf); }
  const quadtree::Quadtree& tree() const { return tree_; }
  triangulation::RegionId regionAt(triangulation::Point2 p) const override { return tree_.tagAt(mesh_.absolute(p)); }

 private:
  // A removed leaf and its successors: the merged leaf, the split children, or none.
  struct RemovedLeaf {
    std::unique_ptr<Leaf> leaf;
    Leaf* whole = nullptr;
    std::vector<Leaf*> parts;
  };
  // What one generate() changes: leaves in canonical order.
  struct LeafDiff {
    std::vector<Leaf*> made;
    std::vector<RemovedLeaf> removed;
  };
  struct Grid {  // what a new leaf lacks of its own
    Leaf* leaf;
    std::vector<refinement::GridPoint> points;
  };

  void moveAnchor(const camera::Pose& pose, bool keep);
  void clear();
  LeafDiff replaceLeaves();
  static void findSuccessors(LeafDiff& diff);
  void replaceOrdered(const LeafDiff& diff);
  void refile(const std::vector<RemovedLeaf>& removed, scheduling::Pool& pool);
  std::vector<Grid> missingGrids(const LeafDiff& diff);
  void insertGrids(std::vector<Grid> grids);
  void dropOutside();
  void updateNeighbours(const LeafDiff& diff, scheduling::Pool& pool);
  void compact();

  quadtree::Quadtree tree_;
  refinement::AdaptiveMesh mesh_;
  std::vector<std::unique_ptr<Leaf>> leaves_;  // by region; null: unused
  std::vector<Leaf*> ordered_;
  std::vector<lattice::LeafAddress> addresses_;
  std::vector<triangulation::RegionId> regions_;
  std::vector<triangulation::RegionId> sparse_;  // to be compacted next time; some may be gone
  bool selected_ = false;                        // leaves came or went, and generate() is due
};

}  // namespace ridgecast::generation
