#pragma once
// What is asked of a terrain by messages, and how far a mesh is from it. Pure functions; any thread.

#include <span>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::query {

// A query that was decoded is in range; heights and normals of kMaxPlaces places take some hundred microseconds, rays, at the farthest,
// some hundred microseconds each.
wire::Answer answer(const terrain::Terrain& terrain, const wire::Query& query);

// Metres that the true terrain lies above or below the leaf's triangles at most. It is looked at on a grid of 1/2^fineness of the leaf's
// side (but not finer than 1/8 m) over each triangle, in its middle and at its corners; what two neighbours of that grid differ by, half,
// is added for what lies between them. 0 for an empty leaf.
float deviation(const terrain::Terrain& terrain, const mesh::LeafMesh& leaf, int fineness = 6);

}  // namespace ridgecast::query
