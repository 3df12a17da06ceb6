#pragma once
// What a leaf starts with after a split or merge: the triangles that already exist.

#include <span>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::mesh {

// The triangles of `sources` whose centroid lies in the square of `address`, in its frame and in canonical order. The sources are the
// ancestors and descendants that were held before. Skips triangles with a vertex more than 2^27 steps from the new corner; sound leaves
// have none.
LeafMesh gather(lattice::LeafAddress address, std::span<const LeafMesh* const> sources);

}  // namespace ridgecast::mesh
