#pragma once
// Shades (shade.h) of a terrain.

#include <array>
#include <span>

#include "common/terrain/shade.h"
#include "common/terrain/terrain.h"

namespace ridgecast::terrain {

Shade makeShade(const std::array<float, 3>& normal, const std::array<float, 3>& colour);

// The shades of points in a leaf of this level: differences and detail are as wide as its triangles, at least 2^level half metres. Requires
// terrain.colours(). `out` has the same size as x and z.
void shadesAt(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, int level, std::span<Shade> out);

}  // namespace ridgecast::terrain
