// Compiled once for each instruction set, with RIDGECAST_VARIANT naming it. Everything but the one function that hands the pointers out
// lives in a namespace of that name, and nothing here may call an inline function from outside it: the linker keeps one copy of those,
// and it could be the one that this machine cannot run. Hence also no std::span and no std::min below.

#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace RIDGECAST_VARIANT {
namespace {

#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"

namespace alpine {
#include "common/terrain/alpine.glsl"
}

constexpr std::size_t kBlock = 256;  // points; the scratch arrays stay in the first-level cache
constexpr std::size_t kLanes = 16;   // blocks are padded to whole vectors of the widest variant

// `flatten` inlines the whole terrain function, which is what lets the loop over points become vector code.
__attribute__((flatten)) void alpineHeights(const lattice::Step* x, const lattice::Step* z, float* out, std::size_t count, std::uint32_t seed) {
  alignas(64) std::uint32_t cellX[kBlock];
  alignas(64) std::uint32_t cellZ[kBlock];
  alignas(64) std::int32_t inX[kBlock];
  alignas(64) std::int32_t inZ[kBlock];
  alignas(64) float result[kBlock];
  constexpr std::uint32_t kMask = (std::uint32_t{1} << lattice::kCellBits) - 1;
  constexpr float kScale = 1.0f / (1 << lattice::kCellBits);
  while (count > 0) {
    const std::size_t n = count < kBlock ? count : kBlock;
    const std::size_t padded = (n + kLanes - 1) / kLanes * kLanes;
    for (std::size_t i = 0; i < n; ++i) {
      cellX[i] = static_cast<std::uint32_t>(static_cast<std::uint64_t>(x[i]) >> lattice::kCellBits);
      cellZ[i] = static_cast<std::uint32_t>(static_cast<std::uint64_t>(z[i]) >> lattice::kCellBits);
      inX[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(x[i]) & kMask);
      inZ[i] = static_cast<std::int32_t>(static_cast<std::uint32_t>(z[i]) & kMask);
    }
    for (std::size_t i = n; i < padded; ++i) cellX[i] = cellZ[i] = 0, inX[i] = inZ[i] = 0;
#pragma omp simd
    for (std::size_t i = 0; i < padded; ++i) {
      const ivec2 cell(static_cast<int>(cellX[i]), static_cast<int>(cellZ[i]));
      const vec2 fraction(static_cast<float>(inX[i]) * kScale, static_cast<float>(inZ[i]) * kScale);
      result[i] = alpine::terrainHeight(cell, fraction, 0.0f, seed);
    }
    __builtin_memcpy(out, result, n * sizeof(float));
    x += n;
    z += n;
    out += n;
    count -= n;
  }
}

float alpineFiltered(lattice::Step x, lattice::Step z, float footprint, std::uint32_t seed) {
  constexpr std::uint32_t kMask = (std::uint32_t{1} << lattice::kCellBits) - 1;
  constexpr float kScale = 1.0f / (1 << lattice::kCellBits);
  const ivec2 cell(static_cast<int>(x >> lattice::kCellBits), static_cast<int>(z >> lattice::kCellBits));
  const vec2 fraction(static_cast<float>(static_cast<int>(static_cast<std::uint32_t>(x) & kMask)) * kScale,
                      static_cast<float>(static_cast<int>(static_cast<std::uint32_t>(z) & kMask)) * kScale);
  return alpine::terrainHeight(cell, fraction, footprint, seed);
}

}  // namespace
}  // namespace RIDGECAST_VARIANT

#define RIDGECAST_JOIN_(a, b) a##b
#define RIDGECAST_JOIN(a, b) RIDGECAST_JOIN_(a, b)
#define RIDGECAST_TEXT_(a) #a
#define RIDGECAST_TEXT(a) RIDGECAST_TEXT_(a)

Variant RIDGECAST_JOIN(RIDGECAST_VARIANT, Variant)() {
  return {{RIDGECAST_TEXT(RIDGECAST_VARIANT), sizeof(RIDGECAST_TEXT(RIDGECAST_VARIANT)) - 1}, &RIDGECAST_VARIANT::alpineHeights, &RIDGECAST_VARIANT::alpineFiltered};
}

}  // namespace ridgecast::terrain
