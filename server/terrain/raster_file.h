#pragma once
// Height maps as files: GeoTIFF and TIFF (tiff_file.cpp, by libtiff), PNG (png_file.cpp, by libpng), rows of 16-bit numbers (raw_file.cpp).
// Files are read row by row, or tile row by tile row: never whole into memory, and what they claim is held against their length before
// anything is allocated.
//
// GeoTIFF by libtiff, not GDAL: Debian 12's libgdal-dev conflicts with libboost1.81-dev, which the server needs, and brings 39 packages
// and 90 MB at run time where libtiff brings one; of what GDAL knows beyond libtiff (projections, two hundred other formats) a height
// map needs three tags, read here.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "common/outcome/outcome.h"
#include "server/terrain/raster_options.h"

namespace ridgecast::user_terrain {

// Most that a map may have, and most that one of its rows, tiles or rows of tiles may take while it is read.
inline constexpr std::uint64_t kMostSamples = std::uint64_t{1} << 32;
inline constexpr std::uint64_t kMostRowBytes = std::uint64_t{256} << 20;
// Packed data unpacks to at most so many times its length; a file that claims more is broken, or a trap. (Deflate reaches 1,032.)
inline constexpr std::uint64_t kMostUnpacked = 2000;

struct RasterHeader {
  std::uint32_t width = 0, height = 0;      // samples
  std::optional<double> noData;             // the sample value that stands for none
  std::optional<double> pitch;              // metres, when the file says so
  std::optional<double> easting, northing;  // of the first sample, metres
};

class RasterFile {
 public:
  virtual ~RasterFile() = default;
  virtual const RasterHeader& header() const = 0;
  // The next row, from the north, as stored: `out` has header().width values. Error: the file is cut off or broken.
  virtual Outcome<void> row(std::span<double> out) = 0;
};

// By the name's ending. Errors are one sentence that begins with the file's name: no such file, not what its name says, more than one
// band, cut off, too large, ...
Outcome<std::unique_ptr<RasterFile>> openRaster(const std::filesystem::path& file, const RasterOptions& options);

// Of the three formats; openRaster chooses. `size` is the file's length in bytes.
Outcome<std::unique_ptr<RasterFile>> openTiff(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);
Outcome<std::unique_ptr<RasterFile>> openPng(const std::filesystem::path& file, std::uint64_t size);
Outcome<std::unique_ptr<RasterFile>> openRaw(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);

// Whether so many samples, of so many bytes each, can be in a file of this length and are not too many; `packed` files are shorter.
Outcome<void> checkClaim(const std::string& file, std::uint64_t width, std::uint64_t height, std::uint64_t sampleBytes, std::uint64_t size,
                         bool packed);

}  // namespace ridgecast::user_terrain
