// Compiled once for each instruction set, with RIDGECAST_VARIANT naming it. Everything but the one function that hands the pointers out
// lives in a namespace of that name, and nothing here may call an inline function from outside it: the linker keeps one copy of those,
// and it could be the one that this machine cannot run. Hence also no std::span and no std::min below.

#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace RIDGECAST_VARIANT {
namespace {

#pragma GCC diagnostic ignored "-Wunused-function"  // colours, and noise that this terrain does not call

#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"

namespace alpine {
#include "common/terrain/alpine.glsl"
}

constexpr std::size_t kBlock = 256;  // points; the scratch arrays stay in the first-level cache
constexpr std::size_t kLanes = 16;   // blocks are padded to whole vectors of the widest variant

constexpr std::uint32_t kMask = (std::uint32_t{1} << lattice::kCellBits) - 1;
constexpr float kScale = 1.0f / (1 << lattice::kCellBits);

// One block, as a structure of arrays. `flatten` inlines the whole terrain function, which is what lets the loop become vector code; a
// function of its own with unaliased pointers and an int for a counter is what g++ 12 needs to see that it may.
__attribute__((flatten, noinline)) void alpineBlock(const int* __restrict cellX, const int* __restrict cellZ, const int* __restrict inX,
                                                    const int* __restrict inZ, float* __restrict out, int count, uint seed) {
#pragma omp simd
  for (int i = 0; i < count; ++i) {
    // No named vec2 here: it would become an array of structures, and the loop scalar.
    out[i] = alpine::terrainHeight(ivec2(cellX[i], cellZ[i]),
                                   vec2(static_cast<float>(inX[i]) * kScale, static_cast<float>(inZ[i]) * kScale), 0.0f, seed);
  }
}

void alpineHeights(const lattice::Step* x, const lattice::Step* z, float* out, std::size_t count, std::uint32_t seed) {
  alignas(64) int cellX[kBlock];
  alignas(64) int cellZ[kBlock];
  alignas(64) int inX[kBlock];
  alignas(64) int inZ[kBlock];
  alignas(64) float result[kBlock];
  while (count > 0) {
    const std::size_t n = count < kBlock ? count : kBlock;
    const std::size_t padded = (n + kLanes - 1) / kLanes * kLanes;
    for (std::size_t i = 0; i < n; ++i) {
      cellX[i] = static_cast<int>(x[i] >> lattice::kCellBits);
      cellZ[i] = static_cast<int>(z[i] >> lattice::kCellBits);
      inX[i] = static_cast<int>(static_cast<std::uint32_t>(x[i]) & kMask);
      inZ[i] = static_cast<int>(static_cast<std::uint32_t>(z[i]) & kMask);
    }
    for (std::size_t i = n; i < padded; ++i) cellX[i] = cellZ[i] = 0, inX[i] = inZ[i] = 0;
    alpineBlock(cellX, cellZ, inX, inZ, result, static_cast<int>(padded), seed);
    __builtin_memcpy(out, result, n * sizeof(float));
    x += n;
    z += n;
    out += n;
    count -= n;
  }
}

float alpineFiltered(lattice::Step x, lattice::Step z, float footprint, std::uint32_t seed) {
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
  return {{RIDGECAST_TEXT(RIDGECAST_VARIANT), sizeof(RIDGECAST_TEXT(RIDGECAST_VARIANT)) - 1},
          &RIDGECAST_VARIANT::alpineHeights,
          &RIDGECAST_VARIANT::alpineFiltered};
}

}  // namespace ridgecast::terrain
