#pragma once
// Queries of the true terrain, for simulations. Server and client share this code, so a local answer equals the server's bit for bit (no
// fused multiply-add; no library function except sqrt, which IEEE 754 rounds exactly). Heights themselves are terrain::Terrain::heights.
// Pure functions; any thread.

#include <cstdint>
#include <span>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

inline constexpr std::uint32_t kDefaultSpacing = 16;  // steps: 1/16 m
inline constexpr double kNoHit = -1;

// Origin, direction and reach of a ray.
struct Ray {
  lattice::Step x = 0, z = 0;                             // steps
  double y = 0;                                           // metres
  double directionX = 0, directionY = 0, directionZ = 0;  // of any length but 0
  double reach = 0;                                       // metres
};

// Unit normals (x, y, z of each place) of the plane through the heights `spacing` steps to each side, 0: kDefaultSpacing: along x and along
// z, the slope between the two. `out` has three times the size of x and z. Positions within `spacing` of the lattice's end use the end.
void normals(const terrain::Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::uint32_t spacing,
             std::span<float> out);

// Metres along the ray to its first contact with the ground: 0 if it begins below ground, kNoHit if there is none within its reach or
// before it leaves the lattice. Samples the ground every max(1/4 m, distance / 1024) along the ray, so a thinner obstacle may be missed.
// The contact is located to a few micrometres along the ray, between lattice places 3.9 mm apart. Adds the heights that it took to
// `heights`, if given: up to some 7,000.
double cast(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights = nullptr);

}  // namespace ridgecast::ground
