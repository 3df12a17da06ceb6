#pragma once
// What the ground of a height map is made of (--classes FILE): a GeoTIFF of whole numbers in the map's CRS, such as land cover, with pixels
// and a place of its own; or a file without a CRS that has a pixel for each of the map's samples. `class=VALUE:NAME` says what a value
// stands for; ground of other values, of NoData, and beyond the file is not said (terrain/materials.h).

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

class Classes {
 public:
  // Reads options.classes for a map of this header and shape. A pixel takes four bytes; more than `inMemory` bytes go into a file. Error:
  // the file's; gridOn's; it takes more than `most` bytes; a value that is no whole number; no value has a name, or more than kMaxUnnamed
  // have none.
  static Outcome<Classes> read(const RasterOptions& options, const RasterHeader& map, const terrain::RasterShape& shape,
                               std::uint64_t inMemory, std::uint64_t most, const std::stop_token& stop = {});
  static constexpr std::size_t kMaxUnnamed = 256;

  // The material of the pixel that a place lies in.
  std::uint8_t at(lattice::Step x, lattice::Step z) const;
  const std::vector<std::string>& ownMaterials() const { return own_; }

  std::uint64_t bytes() const { return materials_.bytes(); }
  std::uint64_t content() const { return content_; }  // equal for equal materials at the same place
  const std::string& describe() const { return description_; }

 private:
  explicit Classes(Samples materials) : materials_(std::move(materials)) {}
  Outcome<void> fill(RasterFile& file, const RasterOptions& options, const std::stop_token& stop);

  Samples materials_;
  PixelGrid grid_;
  std::vector<std::string> own_;
  std::uint64_t content_ = 0;
  std::string description_;
};

}  // namespace ridgecast::raster
