#include "server/map/mercator.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/lattice/lattice.h"

namespace ridgecast::map {

Sheet sheetOf(const TileAddress& tile, const Place& origin) {
  constexpr double kRadius = 6'378'137, kRadians = std::numbers::pi / 180;
  const double latitude = origin.latitude * kRadians, scale = std::cos(latitude) * lattice::kStepsPerMetre;
  const double originX = kRadius * origin.longitude * kRadians, originY = kRadius * std::asinh(std::tan(latitude));
  const double half = kRadius * std::numbers::pi, pixel = std::ldexp(2 * half / kTilePixels, -tile.level);
  Sheet out;
  out.columns = out.rows = kTilePixels;
  out.pitchX = out.pitchZ = pixel * scale;
  const double side = kTilePixels * pixel;
  double west = tile.x * side - half - originX;
  if (tile.level > 0) west -= 2 * half * std::round((west + side / 2) / (2 * half));  // the nearer way round the Earth
  out.x = (west + pixel / 2) * scale;
  out.z = (originY - half + (std::ldexp(tile.y, 8) + 0.5) * pixel) * scale;
  return out;
}

void terrarium(float height, std::uint8_t* rgb) {
  const double units = std::clamp(std::floor((double{height} + 32'768) * 256 + 0.5), 0.0, 16'777'215.0);
  const auto v = static_cast<std::uint32_t>(units);
  rgb[0] = static_cast<std::uint8_t>(v >> 16);
  rgb[1] = static_cast<std::uint8_t>(v >> 8 & 255);
  rgb[2] = static_cast<std::uint8_t>(v & 255);
}

}  // namespace ridgecast::map
