#pragma once
// Internal to the room, its tests and benches: one ray by samples alone, for ground of which nothing is known between them.

#include <cstdint>

#include "common/ground/ground.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

// As cast(). Samples the ground every max(1/4 m, distance / 1024) along the ray, so a thinner obstacle may be missed. The contact is
// located to a few micrometres along the ray, between lattice places 3.9 mm apart. Adds the heights that it took to `heights`, if given:
// up to some 7,000. Pure; any thread.
double march(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights = nullptr);

}  // namespace ridgecast::ground
