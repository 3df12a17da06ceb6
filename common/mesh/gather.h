#pragma once
// What a leaf begins with when leaves split or merge: the triangles that were there already.

#include <span>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::mesh {

// The triangles of `sources` whose centroid lies in the square of `address`, in its frame and in canonical order. The sources are leaves
// that were held before and are not any more: its ancestors and descendants. A triangle with a vertex more than 2^27 steps away from the
// new corner is left out; sound leaves have none.
LeafMesh gather(lattice::LeafAddress address, std::span<const LeafMesh* const> sources);

}  // namespace ridgecast::mesh
