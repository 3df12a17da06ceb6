#pragma once
// How the vertices of a mesh look: normals and colours from the terrain itself, not from the triangles.
//
// A vertex stands for the ground around it: its normal is the slope of the true terrain over half as wide a stretch as its triangles, its
// colour the terrain's at that width. Where leaves meet, a vertex is the same in all of them, so there are no seams.

#include <vector>

#include "common/gltf/glb.h"
#include "common/terrain/terrain.h"
#include "server/scheduling/pool.h"
#include "server/box/problem.h"

namespace ridgecast::snapshot {

using box::Watch;

// Adds what is wanted to leaves that have a mesh and nothing else. A terrain without colours in C++ gets none. False: the watch is over.
bool addAttributes(const terrain::Terrain& terrain, bool normals, bool colours, std::vector<gltf::Leaf>& leaves, scheduling::Pool& pool,
                   const Watch& watch);

}  // namespace ridgecast::snapshot
