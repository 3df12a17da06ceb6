#include "common/terrain/raster.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "common/outcome/contract.h"
#include "common/terrain/embedded.h"
#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace {

namespace glsl {
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wshadow"
#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"
#include "common/terrain/raster_color.glsl"
#pragma GCC diagnostic pop
}  // namespace glsl

std::string number(double v) {
  char text[48];
  std::snprintf(text, sizeof text, "%.9g", v);
  std::string out = text;
  if (out.find_first_of(".e") == std::string::npos) out += ".0";
  return out + "f";
}

}  // namespace

bool tileIsValid(const RasterShape& s, TileAddress tile) {
  const auto isBeyond = [](const RasterAxis& axis, std::int64_t index) {
    return std::abs(index) > static_cast<std::int64_t>(2 * lattice::kMaxPosition / (axis.steps() * kTileSide)) + 1;
  };
  return !isBeyond(s.x, tile.i) && !isBeyond(s.z, tile.j);
}

std::optional<GridPlace> onGrid(const Raster& map, lattice::Point place) {
  const RasterShape& shape = map.shape();
  const RasterOrigin origin = map.origin();
  if (!origin.easting || !origin.northing) return std::nullopt;
  const auto fromMiddle = [](const RasterAxis& axis, std::uint32_t samples, lattice::Step v) {
    return lattice::metres(v) - (lattice::metres(axis.origin) + (samples - 1) * (axis.metres() / 2));
  };
  return GridPlace{*origin.easting + fromMiddle(shape.x, shape.width, place.x),
                   *origin.northing - fromMiddle(shape.z, shape.height, place.z)};
}

void cubicHeights(const CubicPlaces& places, int count, float inverseX, float inverseZ, float* out) {
  expects(count > 0 && count <= static_cast<int>(CubicPlaces::kMax), "places fit into their arrays");
  variants().back().cubicHeights(places, count, inverseX, inverseZ, out);
}

Extent extentOf(const lattice::Step* x, const lattice::Step* z, std::size_t count) {
  expects(count > 0, "an extent is that of a place or more");
  return variants().back().extentOf(x, z, count);
}

Colours rasterColours(const RasterShape& shape) {
  const auto lowest = static_cast<float>(shape.lowest * lattice::kMetresPerStep),
             highest = static_cast<float>(shape.highest * lattice::kMetresPerStep);
  return [lowest, highest](const lattice::Step* x, const lattice::Step* z, const float* height, const std::array<float, 3>* normal,
                           float footprint, std::array<float, 3>* out, std::size_t count, std::uint32_t seed) {
    for (std::size_t k = 0; k < count; ++k) {
      const glsl::vec3 c =
          glsl::rasterColor({lattice::cellOf(x[k]), lattice::cellOf(z[k])}, {lattice::fractionOf(x[k]), lattice::fractionOf(z[k])},
                            height[k], {normal[k][0], normal[k][1], normal[k][2]}, footprint, seed, lowest, highest);
      out[k] = {c.x, c.y, c.z};
    }
  };
}

std::string rasterSource(const RasterShape& s) {
  expects(s.width >= 2 && s.height >= 2 && s.lowest <= s.highest, "a map has a shape");
  char content[24];
  std::snprintf(content, sizeof content, "%016llx", static_cast<unsigned long long>(s.content));
  std::string out = "// A height map of " + std::to_string(s.width) + " x " + std::to_string(s.height) + " samples, from (" +
                    std::to_string(s.x.origin) + ", " + std::to_string(s.z.origin) + ") steps on; content " + content + ".\n";
  const auto pair = [](const char* type, const std::string& x, const std::string& z) {
    return std::string(type).append("(").append(x).append(", ").append(z).append(");\n");
  };
  const auto whole = [](const RasterAxis& axis) { return std::to_string(axis.pitch >> kPitchBits); };
  const auto parts = [](const RasterAxis& axis) { return std::to_string(axis.pitch & (pitchOf(1) - 1)); };
  out += "const ivec2 rasterPitch = " + pair("ivec2", whole(s.x), whole(s.z));
  out += "const ivec2 rasterPitchParts = " + pair("ivec2", parts(s.x), parts(s.z));
  out += "const float rasterPitchMetres = " + number(s.finest() * lattice::kMetresPerStep) + ";\n";
  out += "const vec2 rasterPitchInverse = " + pair("vec2", number(s.x.inverse()), number(s.z.inverse()));
  out += "const float rasterLowest = " + number(s.lowest * lattice::kMetresPerStep) + ";\n";
  out += "const float rasterHighest = " + number(s.highest * lattice::kMetresPerStep) + ";\n";
  return out.append(embedded::raster_cubic).append("\n").append(embedded::raster_color).append("\n").append(embedded::raster);
}

// Along one axis the curve leaves the range of its samples by at most an eighth of it (at t = 1/2 the negative weights sum to 1/8); along
// both, by 1/8 + (1 + 2/8) / 8.
RasterBounds boundsOf(const RasterShape& s) {
  const double low = s.lowest * lattice::kMetresPerStep, high = s.highest * lattice::kMetresPerStep, swing = 0.2875 * (high - low) + 0.1;
  return {low - swing, high + swing};
}

void Raster::samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const {
  expects(columns > 0 && rows > 0 && columns <= kTileSide && rows <= kTileSide, "samples are asked for by a tile at most");
  Tile held;
  for (std::int64_t j = z >> kTileBits; j <= (z + rows - 1) >> kTileBits; ++j)
    for (std::int64_t i = x >> kTileBits; i <= (x + columns - 1) >> kTileBits; ++i) {
      tile({i, j}, held);
      for (std::int64_t b = std::max(z, j << kTileBits); b < std::min(z + rows, (j + 1) << kTileBits); ++b)
        for (std::int64_t a = std::max(x, i << kTileBits); a < std::min(x + columns, (i + 1) << kTileBits); ++a)
          out[(b - z) * columns + a - x] = held[static_cast<std::size_t>((b - (j << kTileBits)) * kTileSide + a - (i << kTileBits))];
    }
}

}  // namespace ridgecast::terrain
