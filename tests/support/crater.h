#pragma once
// Metres as steps, and a crater, for tests of edits.

#include <cstdint>

#include "common/edits/operation.h"

namespace ridgecast::testing_support {

constexpr lattice::Step m(double metres) { return static_cast<lattice::Step>(metres * lattice::kStepsPerMetre); }

inline edits::Operation craterAt(double x, double z = 0, double radius = 5, double depth = 1) {
  return {edits::Crater{{m(x), m(z)}, m(radius), static_cast<std::int32_t>(m(depth))}, 0};
}

}  // namespace ridgecast::testing_support
