// Compiled once for each instruction set, named by RIDGECAST_VARIANT. Everything except the function that returns the pointers lives in a
// namespace of that name. Nothing here may call an inline function from outside it: the linker keeps one copy of those, perhaps one that
// this machine cannot run. Hence no std::span and no std::min below.

#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace RIDGECAST_VARIANT {
namespace {

#pragma GCC diagnostic ignored "-Wunused-function"  // noise that no terrain calls

#define RIDGECAST_COLOURS
#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"

namespace alpine {
#include "common/terrain/alpine.glsl"
#include "common/terrain/batch.h"
}  // namespace alpine
namespace canyon {
#include "common/terrain/canyon.glsl"

#include "common/terrain/batch.h"
}  // namespace canyon
namespace archipelago {
#include "common/terrain/archipelago.glsl"

#include "common/terrain/batch.h"
}  // namespace archipelago
static_assert(alpine::kCellBits == lattice::kCellBits);

}  // namespace
}  // namespace RIDGECAST_VARIANT

#define RIDGECAST_JOIN_(a, b) a##b
#define RIDGECAST_JOIN(a, b) RIDGECAST_JOIN_(a, b)
#define RIDGECAST_TEXT_(a) #a
#define RIDGECAST_TEXT(a) RIDGECAST_TEXT_(a)

Variant RIDGECAST_JOIN(RIDGECAST_VARIANT, Variant)() {
  using namespace RIDGECAST_VARIANT;
  return {{RIDGECAST_TEXT(RIDGECAST_VARIANT), sizeof(RIDGECAST_TEXT(RIDGECAST_VARIANT)) - 1},
          {{{&alpine::heights, &alpine::colours}, {&canyon::heights, &canyon::colours}, {&archipelago::heights, &archipelago::colours}}}};
}

}  // namespace ridgecast::terrain
