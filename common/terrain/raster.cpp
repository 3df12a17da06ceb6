#include "common/terrain/raster.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

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
  variants().back().cubicHeights(places, count, inverseX, inverseZ, out);
}

Extent extentOf(const lattice::Step* x, const lattice::Step* z, std::size_t count) { return variants().back().extentOf(x, z, count); }

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

namespace {

std::int64_t guess(std::span<const std::int32_t> samples, std::size_t columns, std::size_t k) {
  if (k == 0) return 0;
  if (k % columns == 0) return samples[k - columns];
  if (k < columns) return samples[k - 1];
  return std::int64_t{samples[k - 1]} + samples[k - columns] - samples[k - columns - 1];
}

}  // namespace

void encodeSamples(std::span<const std::int32_t> samples, std::size_t columns, std::vector<std::uint8_t>& out) {
  const auto put = [&out](std::uint64_t v) {
    for (; v >= 0x80; v >>= 7) out.push_back(static_cast<std::uint8_t>(v | 0x80));
    out.push_back(static_cast<std::uint8_t>(v));
  };
  std::uint64_t zeros = 0;
  const auto flush = [&] {
    if (zeros == 0) return;
    put(0);
    put(zeros - 1);
    zeros = 0;
  };
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const std::int64_t d = samples[k] - guess(samples, columns, k);
    if (d == 0) {
      ++zeros;
      continue;
    }
    flush();
    put((static_cast<std::uint64_t>(d) << 1) ^ static_cast<std::uint64_t>(d >> 63));
  }
  flush();
}

Outcome<void> decodeSamples(std::span<const std::uint8_t> bytes, std::size_t columns, std::span<std::int32_t> out) {
  std::size_t at = 0;
  const auto get = [&](std::uint64_t& v) {
    v = 0;
    for (int shift = 0; shift < 35; shift += 7) {
      if (at >= bytes.size()) return false;
      const std::uint8_t b = bytes[at++];
      v |= std::uint64_t{b & 0x7fu} << shift;
      if (b < 0x80) return true;
    }
    return false;
  };
  std::uint64_t zeros = 0;
  for (std::size_t k = 0; k < out.size(); ++k) {
    std::int64_t d = 0;
    if (zeros > 0) {
      --zeros;
    } else {
      std::uint64_t v = 0;
      if (!get(v)) return Error{"a tile of heights is cut off"};
      if (v == 0 && !get(zeros)) return Error{"a tile of heights is cut off"};
      d = static_cast<std::int64_t>(v >> 1) ^ -static_cast<std::int64_t>(v & 1);
    }
    const std::int64_t h = guess(out, columns, k) + d;
    if (h < -kMaxSample || h > kMaxSample) return Error{"a tile of heights has one beyond 32,768 m"};
    out[k] = static_cast<std::int32_t>(h);
  }
  if (zeros != 0 || at != bytes.size()) return Error{"a tile of heights is longer than a tile"};
  return {};
}

std::vector<std::uint8_t> encodeTile(const Tile& tile) {
  std::vector<std::uint8_t> out{0x30};
  out.reserve(kTileSamples * 2);
  encodeSamples(tile, kTileSide, out);
  return out;
}

Outcome<Tile> decodeTile(std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || bytes[0] != 0x30) return Error{"a tile of heights has a form that is not known"};
  Tile tile;
  if (auto decoded = decodeSamples(bytes.subspan(1), kTileSide, tile); !decoded) return decoded.error();
  return tile;
}

void Raster::samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const {
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
