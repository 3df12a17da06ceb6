#pragma once
// First meshes: a leaf's grid of 3 x 3 points. Grids nest: a leaf's points are points of its children's grids too. A leaf's own grid
// stays in the mesh while the leaf lives, which bounds the size of triangles and so the reach of a change.

#include <array>

#include "common/lattice/lattice.h"
#include "server/quadtree/quadtree.h"

namespace ridgecast::generation {

// Ascending by x, then z.
std::array<lattice::Point, 9> gridPoints(lattice::LeafAddress leaf);

// False for most points that belong to no leaf's grid, without a look at the tree.
inline bool mayBeGridPoint(lattice::Point p) {
  constexpr lattice::Step finest = (lattice::Step{1} << (lattice::kFinestSideBits - 1)) - 1;  // of half a side
  return ((p.x | p.z) & finest) == 0;
}

// Whether a point belongs to the grid of any leaf of the tree whose closed square holds it.
bool isGridPoint(const quadtree::Quadtree& tree, lattice::Point p);

}  // namespace ridgecast::generation
