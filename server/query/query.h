#pragma once
// Answers queries about a terrain, and measures how far a mesh is from it. Pure functions; any thread.

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::query {

// A decoded query is in range, or its refusal is the answer. Heights and normals of kMaxPlaces places take some hundred microseconds, the
// farthest rays some hundred microseconds each.
wire::Answer answer(const terrain::Terrain& terrain, const wire::Query& query);

// The largest vertical distance in metres between the true terrain and the leaf's triangles. Sampled on a grid of 1/2^fineness of the
// leaf's side (at least 1/8 m) over each triangle and at its centre and corners. Adds half the difference of neighbouring samples for what
// lies between them. 0 for an empty leaf.
float deviation(const terrain::Terrain& terrain, const mesh::LeafMesh& leaf, int fineness = 6);

}  // namespace ridgecast::query
