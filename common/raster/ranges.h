#pragma once
// The least and greatest of a map's samples in any rectangle, from those of blocks of 8 x 8, of 4 x 4 such blocks, and so on.

#include <cstdint>
#include <vector>

#include "common/raster/samples.h"
#include "common/terrain/raster.h"

namespace ridgecast::raster {

// Immutable; any thread. A 29th of the samples' size.
class Ranges {
 public:
  explicit Ranges(const Samples& samples);
  // Samples [x0, x1] x [z0, z1] of the map, or somewhat more around them.
  terrain::Raster::Range of(const Samples& samples, std::uint32_t x0, std::uint32_t z0, std::uint32_t x1, std::uint32_t z1) const;
  std::uint64_t bytes() const;

 private:
  struct Level {
    int bits = 0;  // a block's side in samples, as a power of two
    std::uint32_t width = 0, height = 0;
    std::vector<terrain::Raster::Range> blocks;
  };
  std::vector<Level> levels_;
};

}  // namespace ridgecast::raster
