#pragma once
// What `ridgecast-bench heights` compares with: alpine and the tutorial's terrain in scalar double, one point after the other.

#include <cstddef>
#include <cstdint>

#include "common/lattice/lattice.h"

namespace ridgecast::bench {

void alpineInDouble(const lattice::Step* x, const lattice::Step* z, double* out, std::size_t count, std::uint32_t seed);
void tutorialInDouble(const lattice::Step* x, const lattice::Step* z, double* out, std::size_t count, std::uint32_t seed);

}  // namespace ridgecast::bench
