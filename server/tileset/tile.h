#pragma once
// A tile of 3D Tiles: the mesh of one square of the lattice at the error of its level, and the skirt below its sides.
//
// Tiles are the squares of levels 0 (32 m) to kCoarsest (131 km), as the leaves of a camera's mesh and coarser. A level's error is 1/80 of
// the side, so it doubles from level to level; this takes up to 3,000 triangles of the built-in terrains and some 50 ms. The mesher keeps
// it (server/box): proven over the posts of a height map, otherwise measured. Neighbours of one level share their side bit for bit.

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
// Metres: how far a skirt hangs below its side. Between two sides of levels n and m the gap is at most the sum of their errors, so ten
// errors cover the gaps between tiles that are up to three levels apart.
inline double skirtOf(int level) { return std::ldexp(4, level); }

// Whether it is a tile's square and lies on the lattice as a whole.
bool isTile(lattice::LeafAddress square);

// Where the tile's own coordinates begin: the corner of the 4,096 m cell that contains the square's middle, so the middle itself from level
// 8 upwards. The same as of the file that common/gltf writes of it.
lattice::Point frameOf(lattice::LeafAddress square);

struct Tile {
  mesh::LeafMesh surface;  // canonical
  mesh::LeafMesh skirt;    // not canonical: each vertex of the sides is there twice, as it is and `skirtOf` lower; it faces outwards
  double error = 0;        // metres; at most errorOf(level)
  bool proven = false;     // as in box::BoxMesh
  double spacing = 0;
  std::uint64_t samples = 0;
};

// Problems: as box::Meshing's.
box::Result<Tile> meshTile(const terrain::Terrain& terrain, lattice::LeafAddress square, std::uint32_t mostTriangles,
                           scheduling::Pool& pool, const box::Watch& watch);

}  // namespace ridgecast::tileset
