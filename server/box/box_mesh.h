#pragma once
// The mesh of a box: covers it exactly and keeps a vertical error in metres, for any viewpoint.
//
// The box's sides are divided first, each as a line. Then points are inserted where triangles are worst (Garland and Heckbert 1995, in
// batches) until no triangle's few candidates exceed the error. Then every triangle is sampled densely and what exceeds the error is
// inserted, until nothing does. Vertices lie on the coarsest lattice that costs at most a sixteenth of the error. The result depends only
// on terrain, box and error, not on threads.

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "server/box/problem.h"
#include "server/scheduling/pool.h"

namespace ridgecast::box {

struct Box {
  lattice::Point low, high;  // steps, low < high
  double error = 1;          // metres
  bool rough = false;        // without the dense samples: shows only about how many triangles it takes
};

struct BoxMesh {
  std::vector<mesh::LeafMesh> leaves;  // all of one level, canonical, none empty
  lattice::Point low, high;            // the covered area: the box, widened to the vertices' lattice (by at most a quarter of the error)
  double error = 0;                    // metres: the largest found on `samples` points, at most the requested one
  std::uint64_t samples = 0;
  std::uint32_t triangles = 0;
};

// A mesh in the making, in turns: who shares threads with others does a few milliseconds of it at a time. The turns change nothing about
// the result. One thread at a time; terrain and pool must outlive it.
//
// Problems: more than `mostTriangles` would be needed, the error cannot be reached (a cliff), or the watch is over.
class Meshing {
 public:
  using Time = std::chrono::steady_clock::time_point;

  Meshing(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool, Watch watch);
  ~Meshing();
  // Works until about then. Empty: it is not finished. Not to be called again once it is.
  std::optional<Result<BoxMesh>> work(Time until);

 private:
  class Mesher;
  std::unique_ptr<Mesher> mesher_;
};

// All of it in one turn.
Result<BoxMesh> meshBox(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                        const Watch& watch);

}  // namespace ridgecast::box
