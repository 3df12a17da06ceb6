#pragma once
// Where the pixels of a file lie that is laid on a height map: a picture (drape.h), or classes (classes.h).

#include <string>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/raster/raster_file.h"
#include "common/terrain/raster.h"

namespace ridgecast::raster {

// From steps to pixels, from the middle of the first.
struct PixelAxis {
  lattice::Step origin = 0;
  double first = 0, perStep = 1;
  double at(lattice::Step v) const { return first + static_cast<double>(v - origin) * perStep; }
};

struct PixelGrid {
  PixelAxis x, z;
  std::uint64_t mixedInto(std::uint64_t hash) const;
};

// A pixel for each of the map's samples, where it lies.
PixelGrid gridOfSamples(const terrain::RasterShape& shape);
// Error, for the file of this name: its pixels take more than are left, `most`.
Outcome<void> judgeSize(std::uint64_t bytes, std::uint64_t most, const std::string& name, const std::string& what);
// By the places that both files state. Error, for the file of this name that holds `what`, "a picture": another CRS than the map's, or
// none; pixels too small or too large; it lies beside the map.
Outcome<PixelGrid> gridOn(const terrain::RasterShape& shape, const RasterHeader& map, const RasterHeader& pixels, const std::string& name,
                          const std::string& what);

}  // namespace ridgecast::raster
