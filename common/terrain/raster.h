#pragma once
// A terrain whose heights are samples on a grid: a height map. A rule continues the grid without end beyond the map's edge. Samples are
// whole steps, so heights between them (bicubic, raster_cubic.glsl) have the same bits on every machine and in any shader without fused
// multiply-add.
//
// Samples are counted along x and z from the map's first; indices may be negative. Renderers hold a window of them, in square tiles.

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"

namespace ridgecast::terrain {

inline constexpr std::int32_t kMaxSample = std::int32_t{1} << 23;  // steps, +-: 32,768 m; floats hold their differences
// The distance between samples in parts of a step, so that no sample's place drifts: any file's to 2e-9 m. 6.25 cm to 1,024 m.
using Pitch = std::uint64_t;
inline constexpr int kPitchBits = 20;
constexpr Pitch pitchOf(std::uint32_t steps) { return Pitch{steps} << kPitchBits; }
inline constexpr double kPartsPerMetre = lattice::kStepsPerMetre * double{pitchOf(1)};
inline constexpr Pitch kMinPitch = pitchOf(16), kMaxPitch = pitchOf(1u << 18);
inline constexpr int kTileBits = 7;
inline constexpr std::int32_t kTileSide = 1 << kTileBits;  // samples
inline constexpr std::size_t kTileSamples = std::size_t{kTileSide} * kTileSide;
inline constexpr std::size_t kTileColourBytes = 4 * kTileSamples;

// The sample before a coordinate, and the coordinate's distance beyond it: at least 0, less than the pitch.
struct Between {
  std::int64_t sample = 0;
  Pitch parts = 0;
  float steps() const { return static_cast<float>(parts) * 0x1p-20f; }
};

// Where samples lie along an axis: sample k at origin + k * pitch.
struct RasterAxis {
  lattice::Step origin = 0;    // |.| <= lattice::kMaxPosition
  Pitch pitch = pitchOf(256);  // kMinPitch..kMaxPitch

  double steps() const { return static_cast<double>(pitch) * 0x1p-20; }
  double metres() const { return steps() * lattice::kMetresPerStep; }
  float inverse() const { return static_cast<float>(1 / steps()); }
  Between at(lattice::Step v) const {
    constexpr lattice::Step kNear = lattice::Step{1} << 42;  // 17,000 km: 64 bits suffice, in half the time
    const lattice::Step from = v - origin;
    return from > -kNear && from < kNear ? before(from << kPitchBits, static_cast<std::int64_t>(pitch))
                                         : before(static_cast<Wide>(from) << kPitchBits, static_cast<Wide>(pitch));
  }
  // The step at or just before a sample.
  lattice::Step of(std::int64_t sample) const {
    return origin + static_cast<lattice::Step>((static_cast<Wide>(sample) * pitch) >> kPitchBits);
  }
  // And how far after it, below 2^kPitchBits.
  int partsOf(std::int64_t sample) const { return static_cast<int>(static_cast<Wide>(sample) * pitch & (pitchOf(1) - 1)); }
  friend bool operator==(const RasterAxis&, const RasterAxis&) = default;

 private:
  using Wide = __int128;
  template <class Parts>
  static Between before(Parts from, Parts size) {
    const Parts sample = from >= 0 ? from / size : -((size - 1 - from) / size);
    return {static_cast<std::int64_t>(sample), static_cast<Pitch>(from - sample * size)};
  }
};

struct RasterShape {
  RasterAxis x = {}, z = {};
  std::uint32_t width = 0, height = 0;   // samples of the map itself, along x and z, at least 2
  std::int32_t lowest = 0, highest = 0;  // of all samples with the continuation; within +-kMaxSample, lowest <= highest
  std::uint64_t content = 0;             // equal for equal samples, continuation, picture and materials on them
  bool draped = false;                   // a picture lies on it
  double finest() const { return std::min(x.steps(), z.steps()); }
  lattice::Area area() const { return {x.origin, z.origin, x.of(width - 1), z.of(height - 1)}; }  // of the map itself
  lattice::Point middle() const { return {x.of(width / 2), z.of(height / 2)}; }
  friend bool operator==(const RasterShape&, const RasterShape&) = default;
};

struct TileAddress {
  std::int64_t i = 0, j = 0;  // samples [i, i + 1) x kTileSide along x, j along z
  friend constexpr auto operator<=>(const TileAddress&, const TileAddress&) = default;
};
// Whether all of a tile lies on the lattice, with a tolerance of one tile.
bool tileIsValid(const RasterShape& shape, TileAddress tile);

using Tile = std::array<std::int32_t, kTileSamples>;  // steps, along x first

// A map's origin and its continuation, for people; empty: unknown.
struct RasterOrigin {
  std::string edge;                         // clamp, mirror, repeat or metres
  std::string crs;                          // of the file, such as EPSG:32632
  std::optional<double> easting, northing;  // of the map's middle, metres
  std::string drape, classes;               // the picture and the materials on it; empty: none
  std::string read;                         // how the file was read, where that is not plain
};

// Metres on a map's grid.
struct GridPlace {
  double easting = 0, northing = 0;
};

// A source of samples. Any thread.
class Raster {
 public:
  virtual ~Raster() = default;
  virtual const RasterShape& shape() const = 0;
  virtual RasterOrigin origin() const { return {}; }
  virtual void tile(TileAddress address, Tile& out) const = 0;
  // The picture on a tile, as seen by samples as wide as the pitch: red, green and blue, times alpha and then in sRGB, and alpha; bytes of
  // 1/255, along x first. Empty: none lies there.
  virtual std::vector<std::uint8_t> tileColours(TileAddress) const { return {}; }
  // Bounds of samples [x, x + columns) x [z, z + rows): their least and greatest, or wider.
  struct Range {
    std::int32_t lowest = 0, highest = 0;
  };
  virtual Range range(std::int64_t, std::int64_t, std::int64_t, std::int64_t) const { return {shape().lowest, shape().highest}; }
  // Samples [x, x + columns) x [z, z + rows), each at most kTileSide, along x first. Here by way of tiles.
  virtual void samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const;
};

// Where a place of the world lies on the map's grid; empty: its file does not say.
std::optional<GridPlace> onGrid(const Raster& map, lattice::Point place);

// Places between samples, as a structure of arrays.
struct CubicPlaces {
  static constexpr std::size_t kMax = 64;
  alignas(64) std::int32_t samples[16][kMax] = {};           // 4 x 4 around each place, along x first
  alignas(64) float beyondX[kMax] = {}, beyondZ[kMax] = {};  // steps after the second column and row
  void set(std::size_t place, const std::array<std::int32_t, 16>& around, float x, float z) {
    for (std::size_t i = 0; i < around.size(); ++i) samples[i][place] = around[i];
    beyondX[place] = x;
    beyondZ[place] = z;
  }
};
// Metres at the first `count` places; with the axes' inverse().
void cubicHeights(const CubicPlaces& places, int count, float inverseX, float inverseZ, float* out);
inline float cubicHeight(const std::array<std::int32_t, 16>& around, float x, float z, float inverseX, float inverseZ) {
  CubicPlaces places;
  places.set(0, around, x, z);
  float out = 0;
  cubicHeights(places, 1, inverseX, inverseZ, &out);
  return out;
}

// The least and greatest of `count` places along both axes; count at least 1.
struct Extent {
  lattice::Step x0 = 0, z0 = 0, x1 = 0, z1 = 0;
};
Extent extentOf(const lattice::Step* x, const lattice::Step* z, std::size_t count);

// The height map as a terrain file: its two functions and its constants. Needs what raster.glsl lists.
std::string rasterSource(const RasterShape& shape);

// The file's colours, in C++.
Colours rasterColours(const RasterShape& shape);

// The least and greatest possible height between samples, metres: the curve overshoots its samples.
struct RasterBounds {
  double lowest = 0, highest = 0;
};
RasterBounds boundsOf(const RasterShape& shape);

// Rows of samples <-> bytes, without loss. For each sample, along x first, the zigzag varint of its difference from left + above - above
// left (0 outside; the left one in the first row, the one above in the first column). A run of n >= 1 zeros is 0 followed by the varint
// n - 1.
void encodeSamples(std::span<const std::int32_t> samples, std::size_t columns, std::vector<std::uint8_t>& out);  // appends
// Fills `out`. Error: too short, too long, a sample out of range.
Outcome<void> decodeSamples(std::span<const std::uint8_t> bytes, std::size_t columns, std::span<std::int32_t> out);
// A tile: the byte 0x30 and its samples.
std::vector<std::uint8_t> encodeTile(const Tile& tile);
Outcome<Tile> decodeTile(std::span<const std::uint8_t> bytes);
inline constexpr std::size_t kMaxTileBytes = 1 + 5 * kTileSamples;

}  // namespace ridgecast::terrain
