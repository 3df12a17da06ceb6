#pragma once
// A tile of 3D Tiles: the mesh of one square of the lattice at the error of its level, and the skirt below its sides.
//
// Tiles are the squares of levels 0 (32 m) to kCoarsest (131 km), as the leaves of a camera's mesh and coarser. Usually a level's error is
// 1/80 of the side, so it doubles from level to level; this takes up to 3,000 triangles of the built-in terrains and some 50 ms. The mesher
// keeps it (server/box): proven over the posts of a height map, otherwise measured. Neighbours of one level and error share their side bit
// for bit, also where both are cut off at the border of what is covered, but for tiles with ramps.
//
// Where no mesh keeps the error, at a step of the ground such as a cliff, or with more triangles than a tile may have, a tile is made all
// the same: a viewer draws nothing in place of a tile that fails, and neither keeping the parent nor a tile as coarse as the cliff is high
// would show the ground beside it. Steps become ramps (ramps.h), `ramp` wide, and beside them the error is kept. There `error` includes the
// step; a tileset's geometricError does not: with a cliff's height viewers would load the finest tiles for miles around it. Skirts of such
// tiles hang down to the ground below.

#include <cmath>
#include <cstdint>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "server/box/box_mesh.h"

namespace ridgecast::tileset {

inline constexpr int kCoarsest = 12;

// Metres: the greatest vertical distance between a tile of this level and the ground.
inline double errorOf(int level) { return std::ldexp(0.4, level); }
inline constexpr double kEarthRadius = 6'330'000;  // metres, the least of the ellipsoid's curvature
// Metres: how far a tile's corners are above the globe where the plane of a tile of this level touches it in the tile's middle.
inline double dropOf(int level) {
  const double side = lattice::metres(lattice::LeafAddress{level, 0, 0}.side());
  return side * side / (4 * kEarthRadius);
}
// Metres: how far the skirt of a tile with this error hangs below its sides. Between two sides the gap is at most the sum of their errors,
// so ten errors cover the gaps between tiles that are up to three levels apart.
inline double skirtOf(double error) { return 10 * error; }

// Whether it is a tile's square and lies on the lattice as a whole.
bool isTile(lattice::LeafAddress square);

// Where the tile's own coordinates begin: the corner of the 4,096 m cell that contains the square's middle, so the middle itself from level
// 8 upwards. The same as of the file that common/gltf writes of it.
lattice::Point frameOf(lattice::LeafAddress square);

struct Wanted {
  lattice::LeafAddress square;
  box::Box box;  // the covered part of the square, and the error
};
inline Wanted whole(lattice::LeafAddress square) {
  return {square, {{square.x(), square.z()}, {square.x() + square.side(), square.z() + square.side()}, errorOf(square.level)}};
}

struct Tile {
  mesh::LeafMesh surface;    // canonical
  mesh::LeafMesh skirt;      // not canonical: each vertex of the sides is there twice, as it is and `skirtOf` lower; it faces outwards
  double ramp = 0;           // metres; 0: there is none
  lattice::Point low, high;  // as in box::BoxMesh, like all that follows
  double error = 0;
  bool proven = false;
  double spacing = 0;
  std::uint64_t samples = 0;
};

// At most `mostTriangles`, and 262,080; without ramps a formula's has 16,380. Problems: the watch is over.
box::Result<Tile> meshTile(const terrain::Terrain& terrain, const Wanted& wanted, std::uint32_t mostTriangles, scheduling::Pool& pool,
                           const box::Watch& watch);

}  // namespace ridgecast::tileset
