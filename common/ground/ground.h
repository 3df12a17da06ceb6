#pragma once
// Queries of the true terrain, for simulations. Server and client share this code, so a local answer equals the server's bit for bit (no
// fused multiply-add; no library function except sqrt, which IEEE 754 rounds exactly). Heights themselves are terrain::Terrain::heights.
// Functions of their arguments; any thread.

#include <cstdint>
#include <span>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

inline constexpr double kNoHit = -1;

// Origin, direction and reach of a ray.
struct Ray {
  lattice::Step x = 0, z = 0;                             // steps
  double y = 0;                                           // metres
  double directionX = 0, directionY = 0, directionZ = 0;  // of any length but 0
  double reach = 0;                                       // metres
};

// Metres along each ray to its first contact with the ground: 0 if it begins below ground, kNoHit if there is none within its reach or
// before it leaves the lattice. Located to 4 mm along the ray, or to the lattice, whose places are 3.9 mm apart.
//
// Bounds of the ground over squares say where a ray may meet it; there the ground itself is asked. They are made where rays come by and
// kept with the terrain, at most 60 MiB and 4 MiB more once all terrains of the process have 110; the least recently used are forgotten,
// and no answer depends on what is kept. What they are worth depends on what is known of the ground (terrain::Relief):
//   kProven    a contact is missed only if it is shorter than max(1/64 m, distance / 16,384) along the ray
//   kMeasured  the same, but made from the unevenness of samples nearby, not proven
//   kSampled   no bounds: samples every max(1/4 m, distance / 1,024) along the ray, so a thinner obstacle may be missed (march.h)
// Edits of either kind of known ground have proven bounds.
//
// Equal bits whatever the threads, the instruction set and the company of a ray. Adds the heights that it took to `heights`, if given: some
// ten a ray on known ground where others came by before, some thousand for bounds at a new place, up to some 7,000 on unknown ground. `out`
// has the size of `rays`.
void cast(const terrain::Terrain& terrain, std::span<const Ray> rays, std::span<double> out, std::uint64_t* heights = nullptr);
double cast(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights = nullptr);

}  // namespace ridgecast::ground
