#pragma once
// Predicts a vertex's height from its neighbours: that of their best-fitting plane there, each weighted by 1 / distance^2; their mean if
// they are collinear. The same on both sides, to the bit: plain double arithmetic, one rounding an operation, in an order that depends on
// positions alone.

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/triangulation/triangulation.h"

namespace ridgecast::points {

struct Guess {
  std::int32_t y = 0;   // steps; within the lattice's heights
  bool isSure = false;  // of a plane
};

// Keeps memory between calls. Not thread-safe.
class Guesser {
 public:
  // isKnown(u): whether the height of vertex u is known already. Without known neighbours: the last guess.
  template <class IsKnown>
  Guess guess(const triangulation::Triangulation& mesh, triangulation::VertexId v, IsKnown&& isKnown) {
    ring_.clear();
    mesh.forEachAround(v, [&](triangulation::HalfEdge h) {
      const triangulation::VertexId u = mesh.origin(triangulation::Triangulation::next(h));
      if (u != triangulation::kInfinite && isKnown(u)) ring_.push_back(mesh.vertex(u));
    });
    return last_ = fit(mesh.vertex(v).point());
  }

 private:
  Guess fit(triangulation::Point2 at);
  std::vector<triangulation::Vertex> ring_;  // known neighbours, counter-clockwise
  Guess last_;
};

}  // namespace ridgecast::points
