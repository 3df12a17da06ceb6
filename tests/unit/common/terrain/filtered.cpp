#include "tests/unit/common/terrain/filtered.h"

namespace ridgecast::terrain {
namespace {

#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wshadow"
#include "common/terrain/glsl_as_cpp.h"
#include "common/terrain/prelude.glsl"
namespace alpine {
#include "common/terrain/alpine.glsl"
}
namespace canyon {
#include "common/terrain/canyon.glsl"
}
namespace archipelago {
#include "common/terrain/archipelago.glsl"
}

}  // namespace

float filteredHeight(std::size_t index, lattice::Step x, lattice::Step z, float footprint, std::uint32_t seed) {
  constexpr decltype(&alpine::terrainHeight) kFiles[] = {&alpine::terrainHeight, &canyon::terrainHeight, &archipelago::terrainHeight};
  return kFiles[index]({lattice::cellOf(x), lattice::cellOf(z)}, {lattice::fractionOf(x), lattice::fractionOf(z)}, footprint, seed);
}

}  // namespace ridgecast::terrain
