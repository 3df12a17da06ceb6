#pragma once
// Heights of a terrain as a Cloud Optimized GeoTIFF, which every GIS reads: 32-bit floats in metres, with overviews, in the CRS of the
// height map where it has one; else eastings are x and northings -z. A height is the ground's at the nearest step; where the samples are
// the map's own, theirs, with what edits add. GDAL's programs write it (Debian: gdal-bin).

#include <string>

#include "common/terrain/terrain.h"
#include "server/scheduling/pool.h"
#include "server/snapshot/question.h"
#include "server/snapshot/snapshot.h"

namespace ridgecast::snapshot {

// `tellsPlace`: the file has the map's CRS. `description`: a text that it carries (the tag ImageDescription). Blocks; any thread.
Result<std::string> writeGeoTiff(const terrain::Terrain& terrain, const OfGrid& grid, bool tellsPlace, const std::string& description,
                                 scheduling::Pool& pool, const box::Watch& watch, Progress* progress);

}  // namespace ridgecast::snapshot
