#pragma once
// A height map as a terrain, perhaps draped with a picture. Files are read row by row. Samples are kept as whole steps: in memory up to
// MapLimits::inMemory, otherwise in an unnamed temporary file that the system pages in on demand. After that a height is a few reads: no
// lock, no wait, no failure.
//
// Terrains of one file with the same options share their samples and pixels while any of them lives. A file that was written again is
// another.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/raster/raster_options.h"
#include "common/raster/samples.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"

namespace ridgecast::raster {

// Bytes of all maps and pictures in use, four a sample. What would exceed the first goes into a temporary file; beyond the second it is
// refused.
struct MapLimits {
  std::uint64_t inMemory = std::uint64_t{1} << 30;
  std::uint64_t total = std::uint64_t{1} << 34;  // the largest map alone: kMaxSamples
};

// Maps an index on the endless axis to a map of n samples, n >= 2; empty: beyond the edge, with a constant there.
std::optional<std::uint32_t> folded(std::int64_t k, std::uint32_t n, Edge edge);

// Reads a file (raster_file.h) and its picture (drape.h) whole, unless they are in use. Any thread; files are read one at a time. Error:
// those of openRaster, row() and Drape::read; missing samples without nodata=; heights beyond 32,768 m; positions beyond the lattice; more
// than limits.total in use; or a stop.
Outcome<std::shared_ptr<const terrain::Terrain>> loadRaster(const std::filesystem::path& file, const RasterOptions& options,
                                                            std::uint32_t seed, const MapLimits& limits = {},
                                                            const std::stop_token& stop = {});

// Other files that a map in use was read from: those that a VRT names, the maps of a folder.
std::vector<std::filesystem::path> otherFilesOf(const std::filesystem::path& map);

// What was understood of a height map, in a line.
std::string describe(const terrain::Raster& map);

std::uint64_t bytesOfMaps();  // in use: samples with ranges.h, and pixels

}  // namespace ridgecast::raster
