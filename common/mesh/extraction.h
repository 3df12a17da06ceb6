#pragma once
// Takes leaves' meshes out of a triangulation.

#include <cstdint>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::mesh {

// Keeps memory between calls. Not thread-safe.
class Extractor {
 public:
  // The region's triangles and their vertices, in any order. `anchor`: where the triangulation's coordinates begin.
  LeafMesh extract(const triangulation::Triangulation& mesh, triangulation::RegionId region, lattice::LeafAddress leaf,
                   lattice::Point anchor);
  // Those of the last mesh, in its order.
  std::span<const triangulation::VertexId> vertices() const { return vertices_; }

 private:
  std::vector<std::uint32_t> places_;  // by vertex: 1 + its place in the mesh; 0 between calls
  std::vector<triangulation::VertexId> vertices_;
};

}  // namespace ridgecast::mesh
