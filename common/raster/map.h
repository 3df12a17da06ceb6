#pragma once
// Internal to the room: a height map as it is held, with what lies on it.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/raster/classes.h"
#include "common/raster/drape.h"
#include "common/raster/ranges.h"
#include "common/raster/raster_terrain.h"
#include "common/raster/samples.h"
#include "common/terrain/raster.h"

namespace ridgecast::raster {

// What lies on a map.
struct Laid {
  std::optional<Drape> drape;
  std::optional<Classes> classes;
  std::uint64_t bytes() const { return (drape ? drape->bytes() : 0) + (classes ? classes->bytes() : 0); }
};

// What terrains of one file with the same options share.
struct Map {
  Samples samples;
  Ranges ranges;
  terrain::RasterShape shape;
  Edge edge;
  std::int32_t constant;
  terrain::RasterOrigin origin;
  Laid laid;
  std::vector<std::filesystem::path> sources;  // RasterHeader
  std::uint64_t bytes() const { return samples.bytes() + ranges.bytes() + laid.bytes(); }
};

// As loadRaster(), whatever is in use; `used`: bytes of the other maps in use.
Outcome<std::shared_ptr<const Map>> readMap(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                            std::uint64_t used, const std::stop_token& stop);

// The same, or the map in use that it is.
Outcome<std::shared_ptr<const Map>> openMap(const std::filesystem::path& path, const RasterOptions& options, const MapLimits& limits,
                                            const std::stop_token& stop);

}  // namespace ridgecast::raster
