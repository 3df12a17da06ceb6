#include "server/generation/grid.h"

namespace ridgecast::generation {

std::array<lattice::Point, 9> gridPoints(lattice::LeafAddress leaf) {
  const lattice::Step half = leaf.side() / 2;
  std::array<lattice::Point, 9> points;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) points[static_cast<std::size_t>(3 * a + b)] = {leaf.x() + a * half, leaf.z() + b * half};
  return points;
}

bool isGridPoint(const quadtree::Quadtree& tree, lattice::Point p) {
  if (!mayBeGridPoint(p)) return false;
  for (int k = 0; k < 4; ++k) {
    lattice::LeafAddress leaf;
    if (!tree.leafAt({p.x - (k & 1), p.z - (k >> 1)}, leaf)) continue;
    const lattice::Step half = leaf.side() / 2 - 1;
    if (((p.x | p.z) & half) == 0) return true;
  }
  return false;
}

}  // namespace ridgecast::generation
