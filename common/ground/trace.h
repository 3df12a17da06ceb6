#pragma once
// Internal to the room: rays over ground of which bounds are known. They go from cell to cell, coarse where the ground lies far below, down
// to where they may meet it. There the ground itself is asked, for a packet of rays at a time.

#include <cstdint>
#include <span>

#include "common/ground/ground.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

// As cast(), at most kPacket rays. Returns the heights that it took.
inline constexpr std::size_t kPacket = 64;
std::uint64_t trace(const terrain::Terrain& terrain, std::span<const Ray> rays, std::span<double> out);

}  // namespace ridgecast::ground
