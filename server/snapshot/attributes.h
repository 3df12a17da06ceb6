#pragma once
// Normals, colours and materials of a mesh's vertices, from the terrain itself, not from the triangles. A normal is the slope of the true
// terrain over half the width of the vertex's triangles; a colour is the terrain's at that width. A vertex is the same in all leaves that
// share it, and in other boxes and tiles of the same error that share a side: there its width is the distance to the nearer neighbour
// along it, which both know, and at corners, which four know, it follows from the error. So there are no seams.

#include <optional>
#include <vector>

#include "common/gltf/glb.h"
#include "common/terrain/terrain.h"
#include "server/box/problem.h"
#include "server/scheduling/pool.h"

namespace ridgecast::snapshot {

using box::Watch;

// Of a box or a tile.
struct Sides {
  lattice::Point low, high;
  double error = 0;  // metres
};

struct Attributes {
  bool normals = true, colours = true, materials = false;
};

// Adds the requested attributes to a document whose leaves have only a mesh. A terrain without colours in C++ gets none. False: the watch
// is over.
bool addAttributes(const terrain::Terrain& terrain, const Attributes& wanted, gltf::Document& document, const std::optional<Sides>& sides,
                   scheduling::Pool& pool, const Watch& watch);

}  // namespace ridgecast::snapshot
