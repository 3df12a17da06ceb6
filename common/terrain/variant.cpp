// Compiled once for each instruction set, named by RIDGECAST_VARIANT. Everything except the function that returns the pointers lives in a
// namespace of that name. Nothing here may call an inline function from outside it: the linker keeps one copy of those, perhaps one that
// this machine cannot run. Hence no std::span and no std::min below.

#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace RIDGECAST_VARIANT {
namespace {

#pragma GCC diagnostic ignored "-Wunused-function"  // noise that no terrain calls

#define RIDGECAST_COLOURS
#define RIDGECAST_MATERIALS
#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"

// A terrain is a struct: the file's constants are members with their defaults, its parameters among them, so that one code serves all
// their values.
struct Alpine {
#include "common/terrain/alpine.glsl"

#include "common/terrain/materials.glsl"

#include "common/terrain/alpine_material.glsl"

#include "common/terrain/batch.h"
};
struct Canyon {
#include "common/terrain/canyon.glsl"

#include "common/terrain/materials.glsl"

#include "common/terrain/canyon_material.glsl"

#include "common/terrain/batch.h"
};
struct Archipelago {
#include "common/terrain/archipelago.glsl"

#include "common/terrain/materials.glsl"

#include "common/terrain/archipelago_material.glsl"

#include "common/terrain/batch.h"
};
struct Cubic {
#include "common/terrain/raster_cubic.glsl"

  __attribute__((flatten, noinline)) void heights(const CubicPlaces& places, int count, float inverseX, float inverseZ,
                                                  float* __restrict out) {
    const auto& s = places.samples;
#pragma omp simd
    for (int k = 0; k < count; ++k)
      out[k] = rasterCubic(ivec4(s[0][k], s[1][k], s[2][k], s[3][k]), ivec4(s[4][k], s[5][k], s[6][k], s[7][k]),
                           ivec4(s[8][k], s[9][k], s[10][k], s[11][k]), ivec4(s[12][k], s[13][k], s[14][k], s[15][k]),
                           vec2(places.beyondX[k] * inverseX, places.beyondZ[k] * inverseZ));
  }
};
static_assert(Alpine::kCellBits == lattice::kCellBits);

// In the order of the file; null: the file's own.
Alpine alpine(const float* p) { return p ? Alpine{.snowLine = p[0], .treeLine = p[1]} : Alpine{}; }
Canyon canyon(const float* p) { return p ? Canyon{.riverLevel = p[0]} : Canyon{}; }
Archipelago archipelago(const float* p) { return p ? Archipelago{.heathLine = p[0]} : Archipelago{}; }

template <auto kMake>
void heights(const lattice::Step* x, const lattice::Step* z, float* out, std::size_t count, std::uint32_t seed, const float* parameters) {
  kMake(parameters).heights(x, z, out, count, seed);
}
template <auto kMake>
void colours(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal, float footprint, float* out,
             std::size_t count, std::uint32_t seed, const float* parameters) {
  kMake(parameters).colours(x, z, height, normal, footprint, out, count, seed);
}
template <auto kMake>
void materials(const lattice::Step* x, const lattice::Step* z, const float* height, const float* normal, std::uint8_t* out,
               std::size_t count, std::uint32_t seed, const float* parameters) {
  kMake(parameters).materials(x, z, height, normal, out, count, seed);
}
void betweenSamples(const CubicPlaces& places, int count, float inverseX, float inverseZ, float* out) {
  Cubic().heights(places, count, inverseX, inverseZ, out);
}

Extent placesExtent(const lattice::Step* __restrict x, const lattice::Step* __restrict z, std::size_t count) {
  lattice::Step x0 = x[0], x1 = x0, z0 = z[0], z1 = z0;
#pragma omp simd reduction(min : x0, z0) reduction(max : x1, z1)
  for (std::size_t k = 0; k < count; ++k) {
    x0 = x[k] < x0 ? x[k] : x0;
    x1 = x[k] > x1 ? x[k] : x1;
    z0 = z[k] < z0 ? z[k] : z0;
    z1 = z[k] > z1 ? z[k] : z1;
  }
  return {x0, z0, x1, z1};
}

}  // namespace
}  // namespace RIDGECAST_VARIANT

#define RIDGECAST_JOIN_(a, b) a##b
#define RIDGECAST_JOIN(a, b) RIDGECAST_JOIN_(a, b)
#define RIDGECAST_TEXT_(a) #a
#define RIDGECAST_TEXT(a) RIDGECAST_TEXT_(a)

Variant RIDGECAST_JOIN(RIDGECAST_VARIANT, Variant)() {
  using namespace RIDGECAST_VARIANT;
  return {{RIDGECAST_TEXT(RIDGECAST_VARIANT), sizeof(RIDGECAST_TEXT(RIDGECAST_VARIANT)) - 1},
          {{{&heights<alpine>, &colours<alpine>, &materials<alpine>},
            {&heights<canyon>, &colours<canyon>, &materials<canyon>},
            {&heights<archipelago>, &colours<archipelago>, &materials<archipelago>}}},
          &betweenSamples,
          &placesExtent};
}

}  // namespace ridgecast::terrain
