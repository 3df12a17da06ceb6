// Terrains as one would write them by hand: point by point, in double, without vector code. The same GLSL and the
// same loop, everything inlined and footprint 0 known to the compiler as in the batches, with double for float; only the
// guess of inverseRoot, which looks at a float's bits, passes through a float.

#include "tests/bench/heights_double.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace ridgecast::bench {
namespace {

using Single = float;
template <class To, class From>
inline To bits(From v) {
  if constexpr (std::is_same_v<From, double>)
    return std::bit_cast<To>(static_cast<Single>(v));
  else
    return static_cast<To>(std::bit_cast<Single>(v));
}

#pragma GCC diagnostic ignored "-Wunused-function"
#define float double
#define __builtin_bit_cast(type, value) bits<type>(value)
#define __builtin_floorf __builtin_floor
#define __builtin_fabsf __builtin_fabs
#define __builtin_sqrtf __builtin_sqrt
// clang-format off
#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"
namespace alpine {
#include "common/terrain/alpine.glsl"
#include "common/terrain/batch.h"
}
namespace tutorial {
#include "common/terrain/tutorial/dunes.glsl"
#include "common/terrain/batch.h"
}
// clang-format on
#undef float

}  // namespace

void alpineInDouble(const lattice::Step* x, const lattice::Step* z, double* out, std::size_t count, std::uint32_t seed) {
  alpine::heights(x, z, out, count, seed);
}
void tutorialInDouble(const lattice::Step* x, const lattice::Step* z, double* out, std::size_t count, std::uint32_t seed) {
  tutorial::heights(x, z, out, count, seed);
}

}  // namespace ridgecast::bench
