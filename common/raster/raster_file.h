#pragma once
// Height maps as files: GeoTIFF and TIFF (tiff_file.cpp, by libtiff), PNG (png_file.cpp, by libpng), rows of 16-bit numbers, among them
// those of SRTM (raw_file.cpp), ESRI's ASCII grids (asc_file.cpp). And pictures to drape over them: GeoTIFF. Everything else, and each of
// these that says more than its reader here reads, by GDAL's programs (gdal_file.cpp): a file is read completely, or refused.
// Files are read by row or by row of tiles, never whole into memory. Their claims are compared with their length before anything is
// allocated.
//
// Why GDAL's programs and not its library: Debian 12's libgdal-dev conflicts with libboost1.81-dev, which the server needs, and brings 39
// packages and 90 MB at run time where libtiff brings one; and what a hostile file does to a program does not happen to the server.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"
#include "common/raster/degrees.h"
#include "common/raster/raster_options.h"

namespace ridgecast::raster {

// The most samples of a map, and the most memory for one of its rows, tiles or rows of tiles while reading.
inline constexpr std::uint64_t kMaxSamples = std::uint64_t{1} << 32;
inline constexpr std::uint64_t kMaxRowBytes = std::uint64_t{256} << 20;
// Packed data unpacks to at most this many times its length; a file that claims more is broken or malicious. (Deflate reaches 1,032.) Up to
// kBelieved bytes it may be an empty sea, but for a single row.
inline constexpr std::uint64_t kMaxUnpacked = 2000, kBelieved = std::uint64_t{512} << 20;

struct RasterHeader {
  std::uint32_t width = 0, height = 0;         // samples
  std::optional<double> noData;                // the value of missing samples
  std::optional<double> pitch;                 // metres from column to column, if the file states it in a unit that is known
  double pitchDown = 0;                        // and from row to row, if there is a pitch
  std::optional<double> easting, northing;     // of the first sample, metres
  std::uint16_t epsg = 0;                      // of the projected coordinate system; 0: unknown
  std::string crs;                             // of one without such a number, for PROJ; empty: unknown
  std::optional<DegreeGrid> degrees;           // instead of the pitch and the place, if the file is in degrees
  double heightUnit = 1;                       // metres
  std::string unread;                          // what the file says beyond that, as the beginning of a sentence; empty: nothing
  std::string read;                            // how it was read, where that is not plain
  std::vector<std::filesystem::path> sources;  // other files that it was made of, and the folder

  // Of a picture:
  std::uint16_t bands = 1;       // red, green, blue and perhaps another, a pixel
  bool hasAlpha = false;         // it is the fourth
  bool isPremultiplied = false;  // the others are times alpha
  double white = 255;            // the largest value
};

// What a file's values are.
enum class Content { kHeights, kColours, kClasses };

class RasterFile {
 public:
  virtual ~RasterFile() = default;
  virtual const RasterHeader& header() const = 0;
  // The next row, from the north, as stored: `out` has header().width * bands values. Error: the file is truncated or broken.
  Outcome<void> row(std::span<double> out) {
    expects(out.size() == std::size_t{header().width} * header().bands, "a row has room for its samples");
    return read(out);
  }

 private:
  virtual Outcome<void> read(std::span<double> out) = 0;
};

// A file, or a folder of maps side by side. Chooses by the name's ending. Errors are one sentence that begins with the file's name: no such
// file, content does not match the name, more than one band, truncated, too large, stopped, ...
Outcome<std::unique_ptr<RasterFile>> openRaster(const std::filesystem::path& file, const RasterOptions& options,
                                                const std::stop_token& stop = {});

// A GeoTIFF that is laid on a map, or what GDAL makes of another file: red, green, blue and perhaps alpha, 8 or 16 bits each; or the
// numbers of classes, with a palette or without. Errors as of openRaster.
Outcome<std::unique_ptr<RasterFile>> openLaid(const std::filesystem::path& file, Content content, const std::stop_token& stop = {});

// One of the formats, chosen by openRaster. `size` is the file's length in bytes.
Outcome<std::unique_ptr<RasterFile>> openTiff(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);
Outcome<std::unique_ptr<RasterFile>> openPng(const std::filesystem::path& file, std::uint64_t size);
Outcome<std::unique_ptr<RasterFile>> openRaw(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);
// A square of big-endian signed numbers, -32,768 where there is none; the name says where its south-west corner lies: N47E011.hgt.
Outcome<std::unique_ptr<RasterFile>> openHgt(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);
// Text: ncols, nrows, xllcorner or xllcenter, yllcorner or yllcenter, cellsize, nodata_value, then the rows. A cell of less than 0.0625
// within the degrees of Earth is in degrees, otherwise in metres.
Outcome<std::unique_ptr<RasterFile>> openAsc(const std::filesystem::path& file, std::uint64_t size, const RasterOptions& options);

// Reads a file, or a folder of height maps, by GDAL's programs; `why`: what is not read here, for the refusal if they are not installed.
// They read only the file's folder; they have no network, 10 minutes of a processor and 3 GiB of memory. Error: theirs; a mask, unit,
// projection or number of bands that is no height map.
Outcome<std::unique_ptr<RasterFile>> openByGdal(const std::filesystem::path& file, const std::string& why, const RasterOptions& options,
                                                Content content, const std::stop_token& stop);
// A TIFF's samples alone, as its bands; what else it says is of no interest.
Outcome<std::unique_ptr<RasterFile>> openPlain(const std::filesystem::path& file, Content content);

// A file beside this one that changes what it means, as the beginning of a sentence: a mask, GDAL's .aux.xml and, if the file itself does
// not say where it lies, a world file or a projection. Empty: there is none.
std::string besideIt(const std::filesystem::path& file, bool isPlaced);

// Whether this many samples of this many bytes fit into a file of this length and into the limits; `packed` files are shorter.
Outcome<void> checkClaim(const std::string& file, std::uint64_t width, std::uint64_t height, std::uint64_t sampleBytes, std::uint64_t size,
                         bool packed);

}  // namespace ridgecast::raster
