#include "common/raster/pixels.h"

#include <algorithm>
#include <bit>

#include "common/text/text.h"

namespace ridgecast::raster {
namespace {

Outcome<void> judgePlace(const std::string& name, const RasterHeader& pixels, const RasterHeader& map, const std::string& what) {
  const auto code = [](const RasterHeader& header) { return "EPSG:" + std::to_string(header.epsg); };
  if (!map.easting || map.epsg == 0)
    return Error{name + ": " + what +
                 " needs a height map that says where it lies in metres, by the EPSG number of its CRS: project the map, "
                 "or name its CRS (gdal_translate -a_srs), as a GeoTIFF"};
  if (!pixels.easting || pixels.epsg == 0)
    return Error{name + ": it does not say where it lies in metres, by the EPSG number of its CRS: warp it to the map's (gdalwarp -t_srs " +
                 code(map) + ")"};
  if (pixels.epsg != map.epsg)
    return Error{name + ": it is in " + code(pixels) + " and the height map in " + code(map) + ": warp it (gdalwarp -t_srs " + code(map) +
                 ")"};
  constexpr double kMin = 1e-3, kMax = 1e6;  // metres
  if (!(std::min(*pixels.pitch, pixels.pitchDown) >= kMin && std::max(*pixels.pitch, pixels.pitchDown) <= kMax))
    return Error{name + ": its pixels are " + text::rounded(*pixels.pitch, 6) + " x " + text::rounded(pixels.pitchDown, 6) +
                 " m wide; that must be 0.001 m to 1,000 km: correct its pixel size (gdalwarp -tr)"};
  const double west = *map.easting, north = *map.northing, east = west + (map.width - 1) * *map.pitch,
               south = north - (map.height - 1) * map.pitchDown;
  const double left = *pixels.easting, top = *pixels.northing;
  if (!(left <= east && top >= south && left + (pixels.width - 1) * *pixels.pitch >= west &&
        top - (pixels.height - 1) * pixels.pitchDown <= north))
    return Error{name + ": it lies beside the height map: take " + what + " of eastings " + text::rounded(west, 9) + " to " +
                 text::rounded(east, 9) + ", northings " + text::rounded(south, 9) + " to " + text::rounded(north, 9)};
  return {};
}

}  // namespace

std::uint64_t PixelGrid::mixedInto(std::uint64_t hash) const {
  for (const double v : {x.first, z.first, x.perStep, z.perStep}) hash = lattice::mix(hash ^ std::bit_cast<std::uint64_t>(v));
  return hash;
}

PixelGrid gridOfSamples(const terrain::RasterShape& shape) {
  return {{shape.x.origin, 0, 1 / shape.x.steps()}, {shape.z.origin, 0, 1 / shape.z.steps()}};
}

Outcome<void> judgeSize(std::uint64_t bytes, std::uint64_t most, const std::string& name, const std::string& what) {
  if (bytes <= most) return {};
  return Error{name + ": the " + what + " takes " + inMegabytes(bytes) + ", and " + std::to_string(most / 1'000'000) +
               " MB are left for height maps and what lies on them: make it coarser (gdalwarp -tr)"};
}

Outcome<PixelGrid> gridOn(const terrain::RasterShape& shape, const RasterHeader& map, const RasterHeader& pixels, const std::string& name,
                          const std::string& what) {
  if (auto fine = judgePlace(name, pixels, map, what); !fine) return fine.error();
  PixelGrid grid = gridOfSamples(shape);
  grid.x.first = (*map.easting - *pixels.easting) / *pixels.pitch;
  grid.z.first = (*pixels.northing - *map.northing) / pixels.pitchDown;
  grid.x.perStep *= *map.pitch / *pixels.pitch;
  grid.z.perStep *= map.pitchDown / pixels.pitchDown;
  return grid;
}

}  // namespace ridgecast::raster
