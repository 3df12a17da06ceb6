#pragma once
// Heights and slack of a tile on a height map, from the posts themselves.

#include "common/terrain/raster.h"
#include "server/box/samples.h"

namespace ridgecast::box {

inline constexpr int kPostsACell = 4;  // along a side, at most: more take too long to look at

// What lies between samples of ground that was edited, by the posts of the edits: added to the slack.
void addEdits(const terrain::Raster& edits, const Frame& frame, Tile& tile);

void sampleMap(const terrain::Raster& map, const Frame& frame, Tile& tile);

}  // namespace ridgecast::box
