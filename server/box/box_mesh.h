#pragma once
// The mesh of a box: covers it exactly and keeps to a vertical error in metres, wherever it is looked at from.
//
// The sides of the box are divided first, each as a line of its own; then points are inserted where triangles are worst (Garland and
// Heckbert 1995, in batches), until no triangle's few candidates exceed the error; then every triangle is sampled densely and what still
// exceeds it is inserted as well, until nothing does. The vertices lie on a lattice as coarse as a sixteenth of the error allows. The
// result depends on terrain, box and error alone, not on threads.

#include <cstdint>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "server/scheduling/pool.h"
#include "server/box/problem.h"

namespace ridgecast::box {

struct Box {
  lattice::Point low, high;  // steps, low < high
  double error = 1;          // metres
};

struct BoxMesh {
  std::vector<mesh::LeafMesh> leaves;  // all of one level, canonical, none empty
  lattice::Point low, high;            // what is covered: the box, widened to the vertices' lattice (at most a quarter of the error)
  double error = 0;                    // metres: the largest found on `samples` points, at most the one asked for
  std::uint64_t samples = 0;
  std::uint32_t triangles = 0;
};

// Problems: more than `mostTriangles` would be needed, the error cannot be reached (a cliff), the watch is over.
Result<BoxMesh> meshBox(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                        const Watch& watch);

}  // namespace ridgecast::box
