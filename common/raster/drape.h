#pragma once
// An aerial picture that lies on a height map (--drape): a GeoTIFF in the map's CRS, with pixels and a place of its own. Or colours by
// height (ramp.h).
//
// A colour is the mean of the picture over the footprint: bilinear between the pixels' middles, in linear light, and trilinear in a pyramid
// of half the size each where the footprint is wider than a pixel. Where the picture ends or is transparent it fades into the map's own
// colours.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/raster/pixels.h"
#include "common/raster/raster_file.h"
#include "common/raster/samples.h"
#include "common/terrain/raster.h"

namespace ridgecast::raster {

class Drape {
 public:
  // Reads a picture (openLaid, or openRamp of the samples) for a map of this header and shape. A pixel takes four bytes, and the
  // pyramid a third more; more than `inMemory` bytes go into a file. Error: the file's; another CRS than the map's, or none; it lies
  // beside the map; it takes more than `most` bytes.
  static Outcome<Drape> read(const std::filesystem::path& file, const Samples& samples, const RasterHeader& map,
                             const terrain::RasterShape& shape, std::uint64_t inMemory, std::uint64_t most,
                             const std::stop_token& stop = {});

  // Linear light times alpha, and alpha.
  struct Light {
    std::array<float, 3> colour{};
    float alpha = 0;
  };
  Light at(lattice::Step x, lattice::Step z, float footprint) const;
  // terrain::Raster::tileColours.
  std::vector<std::uint8_t> tile(const terrain::RasterShape& shape, terrain::TileAddress address) const;

  std::uint64_t bytes() const;
  std::uint64_t content() const { return content_; }  // equal for equal pictures at the same place
  std::string describe() const;

 private:
  std::string name_;
  std::vector<Samples> levels_;  // red, green, blue and alpha from the lowest byte on, in sRGB
  PixelGrid grid_;
  std::uint64_t content_ = 0;
};

}  // namespace ridgecast::raster
