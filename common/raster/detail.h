#pragma once
// Procedural detail on a coarse height map, --raster detail=TERRAIN:FACTOR[:PARTS]. The map becomes one of PARTS x PARTS times as many
// samples. The height of each is
//
//   map + FACTOR x (terrain - terrain between the map's samples)
//
// rounded to the nearest step (halves upwards): `terrain` is the height of a built-in terrain, seed 1, at the sample's place in the world,
// in steps; `map` and the last term are bicubic between heights at the map's samples, as in raster_cubic.glsl. What these can carry of the
// terrain falls out. So what is added has wavelengths below about two of their distances, and the map's own samples keep their heights
// exactly.
//
// The result is an ordinary height map, so that everybody who has its samples has the same ground.

#include <cstdint>
#include <string>

#include "common/outcome/outcome.h"
#include "common/raster/raster_options.h"
#include "common/raster/samples.h"
#include "common/terrain/raster.h"

namespace ridgecast::raster {

struct Detailed {
  Samples samples;
  terrain::RasterShape shape;  // of those
};

// `options.detail` is set; `shape` is that of `map`. Up to `inMemory` bytes are taken from memory, `total` in all. Errors: a pitch that
// parts do not divide into whole steps; too many samples; heights beyond 32,768 m.
Outcome<Detailed> withDetail(const std::string& name, const Samples& map, const terrain::RasterShape& shape, const RasterOptions& options,
                             std::uint64_t inMemory, std::uint64_t total);

}  // namespace ridgecast::raster
