#pragma once
// Leaves of a mesh as plain arrays, as physics engines and plotting programs take them. Pure functions; any thread.

#include <array>
#include <cstdint>
#include <vector>

#include "client/core/mesh/scene.h"
#include "common/lattice/lattice.h"

namespace ridgecast::world {

// Metres from the origin, +Y up, y absolute: exact within 65 km of it. Triangles are counter-clockwise from above. A vertex shared by
// leaves appears once.
struct Mesh {
  lattice::Point origin;  // steps
  double error = 0;       // metres: the true ground is at most this far above or below; infinite: not known
  std::vector<std::array<float, 3>> positions = {};
  std::vector<std::array<std::uint32_t, 3>> triangles = {};
};

// In canonical order of the leaves: equal leaves give equal arrays.
Mesh meshOf(const core::Leaves& leaves, lattice::Point origin);

}  // namespace ridgecast::world
