#pragma once
// Questions to the true terrain: what a simulation asks. Server and client answer them with this same code, so that a local answer is the
// server's bit for bit (no fused multiply-add, no library function but sqrt, which IEEE 754 rounds exactly).
// Heights themselves are terrain::Terrain::heights. Pure functions; any thread.

#include <cstdint>
#include <span>

#include "common/ground/ray.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

inline constexpr std::uint32_t kDefaultSpacing = 16;  // steps: 1/16 m
inline constexpr double kNoHit = -1;

// Unit normals, x, y, z of each place, of the plane through the heights `spacing` steps to each side: along x and along z the slope
// between the two. `out` has three times the size of x and z. Positions within spacing of the lattice's end are answered there.
void normals(const terrain::Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::uint32_t spacing,
             std::span<float> out);

// Metres along the ray to where it first meets the ground; 0 when it begins below it; kNoHit when it does not within its reach, or leaves
// the lattice before. The ground is looked at every max(1/4 m, distance / 1024) along the ray: what it pierces for less may be missed.
// Where it is met is then found to a few micrometres along the ray, between lattice places 3.9 mm apart.
double cast(const terrain::Terrain& terrain, const Ray& ray);

}  // namespace ridgecast::ground
