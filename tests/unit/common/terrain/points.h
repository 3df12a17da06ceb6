#pragma once
// Points at which terrains are tried: near the origin, and 1e6, 1e8 and 1e12 m out.

#include <array>
#include <cstdint>
#include <random>
#include <vector>

#include "common/lattice/lattice.h"

namespace ridgecast::terrain {

inline constexpr std::array<double, 4> kDistances{0.0, 1e6, 1e8, 1e12};  // metres

struct Points {
  std::vector<lattice::Step> x, z;
};

// `count` points spread over 64 km around (distance, -distance), every eighth on or beside a border of the 4,096 m cells.
inline Points pointsAt(double distance, std::size_t count) {
  std::mt19937_64 random(static_cast<std::uint64_t>(distance) + 1);
  const auto centre = static_cast<lattice::Step>(distance * lattice::kStepsPerMetre);
  Points p;
  for (std::size_t i = 0; i < count; ++i) {
    lattice::Step x = centre + static_cast<lattice::Step>(random() >> 40) - (1 << 23);
    lattice::Step z = -centre + static_cast<lattice::Step>(random() >> 40) - (1 << 23);
    if (i % 8 == 0) x = lattice::floorTo(x, lattice::kCellBits) - static_cast<lattice::Step>(random() % 3) + 1;
    if (i % 16 == 0) z = lattice::floorTo(z, lattice::kCellBits) - static_cast<lattice::Step>(random() % 3) + 1;
    p.x.push_back(x);
    p.z.push_back(z);
  }
  return p;
}

}  // namespace ridgecast::terrain
