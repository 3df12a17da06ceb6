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

// In pieces of at most some milliseconds. The mesh, which does not change any more, must outlive it. One thread.
class Filing {
 public:
  Filing(const triangulation::Triangulation& mesh, const Frame& frame, lattice::Point low, lattice::Point high);
  void add(triangulation::RegionId region);
  bool finish(scheduling::Pool& pool);  // some leaves of what was added; true: there are no more
  std::vector<mesh::LeafMesh> take() { return std::move(leaves_); }

 private:
  struct Leaf {
    mesh::LeafMesh mesh;
    std::vector<triangulation::VertexId> ids;  // three a triangle
  };
  void finish(mesh::LeafMesh& leaf, const std::vector<triangulation::VertexId>& ids) const;

  const triangulation::Triangulation& mesh_;
  const Frame frame_;
  int level_ = 0;
  std::map<lattice::LeafAddress, Leaf> filed_;
  std::vector<mesh::LeafMesh> leaves_;
};

}  // namespace ridgecast::box
