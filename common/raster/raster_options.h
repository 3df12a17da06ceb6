#pragma once
// A user's settings for a height map: --raster NAME=VALUE, --drape FILE, --classes FILE.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::raster {

// How the grid continues beyond the map's edge. Mirror does not repeat the outermost sample, so slopes stay continuous.
enum class Edge { kClamp, kMirror, kRepeat, kConstant };

// What is added between a coarse map's samples (detail.h).
struct Detail {
  std::string terrain;      // a built-in one
  double factor = 0;        // of its heights
  std::uint32_t parts = 0;  // samples in the place of one, along each axis; 0: at most 8
  friend bool operator==(const Detail&, const Detail&) = default;
};

// What a value of a map of classes stands for.
struct NamedClass {
  std::int32_t value = 0;
  std::string material;  // terrain::isMaterialName
  friend bool operator==(const NamedClass&, const NamedClass&) = default;
};

struct RasterOptions {
  std::optional<double> pitch;          // pitch=METRES between samples; default: a GeoTIFF's, otherwise 1
  double scale = 1, offset = 0;         // scale=S offset=O: height = S * sample + O, metres; default: as the file says, which they replace
  Edge edge = Edge::kClamp;             // edge=clamp|mirror|repeat|METRES
  double constant = 0;                  // metres, beyond the edge
  std::optional<double> missing;        // missing=VALUE of samples that are missing; default: as the file says
  std::optional<double> noData;         // nodata=METRES for missing samples; default: such a map is refused
  bool fill = false;                    // nodata=fill: from their neighbours (samples.h)
  bool project = false;                 // project=local: a map in degrees is laid on the plane that touches its middle (degrees.h)
  std::uint32_t width = 0, height = 0;  // size=WxH, of a raw file; default 0: a square, by its length
  bool bigEndian = false;               // order=little|big, of a raw file
  bool isSigned = false;                // type=unsigned|signed, of a raw file
  bool geographic = false;              // place=centre|geo: the map's middle at x 0, z 0, or easting at x and northing at -z
  std::optional<Detail> detail;         // detail=TERRAIN:FACTOR[:PARTS]
  std::filesystem::path drape;          // a picture on it, --drape FILE (drape.h); empty: none
  std::filesystem::path classes;        // of what the ground is made, --classes FILE (classes.h); empty: not said
  std::vector<NamedClass> named;        // class=VALUE:NAME of these
  friend bool operator==(const RasterOptions&, const RasterOptions&) = default;
};

// Adds one assignment. Error: an unknown name or an invalid value; says what would be right.
Outcome<void> addRasterOption(std::string_view assignment, RasterOptions& options);

// Whether a file's name denotes a height map, by its ending in any case: .tif, .tiff, .png, .asc, .hgt, .r16, .raw, and formats that GDAL's
// programs read.
bool isRasterName(std::string_view name);

}  // namespace ridgecast::raster
