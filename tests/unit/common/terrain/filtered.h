#pragma once
// One height of a built-in terrain as seen by a sample `footprint` metres wide, compiled from its file without what the room makes of it.

#include <cstddef>
#include <cstdint>

#include "common/lattice/lattice.h"

namespace ridgecast::terrain {

// `index` is that of builtIn().
float filteredHeight(std::size_t index, lattice::Step x, lattice::Step z, float footprint, std::uint32_t seed);

}  // namespace ridgecast::terrain
