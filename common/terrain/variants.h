#pragma once
// Internal to the room, its tests and benches: the terrain files as C++, compiled once for each instruction set. All variants return the
// same bits; only their speed differs.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "common/lattice/lattice.h"
#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"

namespace ridgecast::terrain {

// Heights in metres at `count` points, as the terrain function returns them.
using HeightsFunction = void (*)(const lattice::Step* x, const lattice::Step* z, float* out, std::size_t count, std::uint32_t seed);
// Colours, see terrain::Colours; normals and results are three floats a point.
using ColoursFunction = void (*)(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal, float footprint,
                                 float* out, std::size_t count, std::uint32_t seed);

// Materials, from heights and normals as the terrain says them.
using MaterialsFunction = void (*)(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal,
                                   std::uint8_t* out, std::size_t count, std::uint32_t seed);

// A built-in terrain: the same with its parameters' values, in the order of the file; null: the file's own.
struct Functions {
  void (*heights)(const lattice::Step* x, const lattice::Step* z, float* out, std::size_t count, std::uint32_t seed,
                  const float* parameters);
  void (*colours)(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal, float footprint, float* out,
                  std::size_t count, std::uint32_t seed, const float* parameters);
  void (*materials)(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal, std::uint8_t* out,
                    std::size_t count, std::uint32_t seed, const float* parameters);
};

inline constexpr std::size_t kBuiltIns = 3;

struct Variant {
  std::string_view name;                     // "baseline", "avx2", "avx512"
  std::array<Functions, kBuiltIns> terrain;  // in the order of builtIn()
  void (*cubicHeights)(const CubicPlaces& places, int count, float inverseX, float inverseZ, float* out);
  Extent (*extentOf)(const lattice::Step* x, const lattice::Step* z, std::size_t count);
};

// Materials of a terrain's points by f(x, z, heights, normals, out, count), a block at a time.
template <class F>
void materialsBy(const F& f, const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z,
                 std::span<std::uint8_t> out) {
  expects(x.size() == out.size() && z.size() == out.size(), "each place has its material");
  std::array<float, 256> height;
  std::array<float, 3 * height.size()> normal;
  for (std::size_t begin = 0; begin < out.size(); begin += height.size()) {
    const std::size_t n = std::min(height.size(), out.size() - begin);
    const auto partX = x.subspan(begin, n), partZ = z.subspan(begin, n);
    terrain.heights(partX, partZ, std::span(height).first(n));
    normals(terrain, partX, partZ, kDefaultSpacing, std::span(normal).first(3 * n));
    f(partX.data(), partZ.data(), height.data(), normal.data(), &out[begin], n);
  }
}

inline Colours asColours(ColoursFunction f) {
  return [f](const lattice::Step* x, const lattice::Step* z, const float* height, const std::array<float, 3>* normal, float footprint,
             std::array<float, 3>* out, std::size_t count,
             std::uint32_t seed) { f(x, z, height, normal->data(), footprint, out->data(), count, seed); };
}

// The variants that this machine can run, slowest first; never empty. Decided once.
std::span<const Variant> variants();

// Each has its own translation unit and flags. Call only those that variants() lists.
Variant baselineVariant();
#ifdef RIDGECAST_TERRAIN_X86
Variant avx2Variant();
Variant avx512Variant();
#endif

}  // namespace ridgecast::terrain
