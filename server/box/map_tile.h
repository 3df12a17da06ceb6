#pragma once
// Heights and slack of a tile on a height map, from the posts themselves.

#include "common/terrain/raster.h"
#include "server/box/samples.h"

namespace ridgecast::box {

inline constexpr int kPostsACell = 4;  // along a side, at most: scanning more takes too long

// Adds to the slack what lies between samples of edited ground, by the posts of the edits.
void addEdits(const terrain::Raster& edits, const Frame& frame, Tile& tile);

void sampleMap(const terrain::Raster& map, const Frame& frame, Tile& tile);

}  // namespace ridgecast::box
