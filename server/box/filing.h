#pragma once
// Files the triangles of a mesh by leaves of one level, chosen for a moderate number of triangles in each.

#include <cstddef>
#include <map>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/triangulation/triangulation.h"
#include "server/box/samples.h"
#include "server/scheduling/pool.h"

namespace ridgecast::box {

// Works in pieces of at most some milliseconds. The mesh, which does not change any more, must outlive it.
class Filing {
 public:
  Filing(const triangulation::Triangulation& mesh, const Frame& frame, lattice::Point low, lattice::Point high, std::size_t regions);
  void add(std::size_t k, triangulation::RegionId region);  // as the k-th; different ones at the same time
  bool finish(scheduling::Pool& pool);                      // some leaves, once all regions are added; true: none are left. One thread
  std::vector<mesh::LeafMesh> take() { return std::move(leaves_); }

 private:
  using Corners = std::vector<triangulation::VertexId>;  // three a triangle
  void finish(mesh::LeafMesh& leaf, const std::vector<const Corners*>& parts) const;

  const triangulation::Triangulation& mesh_;
  const Frame frame_;
  int level_ = 0;
  std::vector<std::map<lattice::LeafAddress, Corners>> added_;
  std::map<lattice::LeafAddress, std::vector<const Corners*>> filed_;
  std::vector<mesh::LeafMesh> leaves_;
};

}  // namespace ridgecast::box
