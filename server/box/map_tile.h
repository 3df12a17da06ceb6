#pragma once
// Heights and slack of a tile on a height map, from the posts themselves.

#include "common/terrain/raster.h"
#include "server/box/samples.h"

namespace ridgecast::box {

inline constexpr int kPostsACell = 4;  // along a side, at most: more take too long to look at

void sampleMap(const terrain::Raster& map, const Frame& frame, Tile& tile);

}  // namespace ridgecast::box
