#pragma once
// Operations of every kind, at random.

#include <cstdint>
#include <random>

#include "common/edits/operation.h"
#include "tests/support/crater.h"

namespace ridgecast::testing_support {

// Places within 60 m of the middle; everything stays within 110 m of it.
inline edits::Operation randomOperation(std::mt19937_64& random, lattice::Point middle) {
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  const auto near = [&] { return lattice::Point{middle.x + m(uniform(-60, 60)), middle.z + m(uniform(-60, 60))}; };
  const auto material = static_cast<std::uint32_t>(random() % 9);
  switch (random() % 6) {
    case 0: {
      const lattice::Step radius = m(uniform(0.5, 20));
      return {edits::Raise{near(), radius, static_cast<lattice::Step>(static_cast<double>(radius) * uniform(0, 1)),
                           static_cast<std::int32_t>(m(uniform(-9, 9)))},
              material};
    }
    case 1:
      return {edits::Crater{near(), m(uniform(0.5, 20)), static_cast<std::int32_t>(m(uniform(0.1, 9)))}, material};
    case 2:
      if (random() % 2)
        return {
            edits::Level{
                {near()}, m(uniform(1, 15)), static_cast<std::int32_t>(m(uniform(900, 1100))), static_cast<std::uint32_t>(uniform(1, 600))},
            material};
      return {edits::Level{{near(), near(), near(), near()}, 0, static_cast<std::int32_t>(m(uniform(900, 1100))), 256}, material};
    case 3:
      return {edits::Smooth{near(), m(uniform(0.5, 20)), static_cast<std::uint32_t>(1 + random() % 16)}, material};
    case 4: {
      edits::Road road;
      for (int k = 0; k < 3; ++k) {
        const lattice::Point p = near();
        road.line.push_back({p.x, p.z, 0});
      }
      road.width = m(uniform(1, 10));
      return {road, material};
    }
    default: {
      edits::Stamp stamp{near(), 5, 4, static_cast<std::uint32_t>(1 + random() % 8), {}};
      for (int k = 0; k < 20; ++k) stamp.samples.push_back(static_cast<std::int32_t>(m(uniform(-3, 3))));
      return {stamp, material};
    }
  }
}

}  // namespace ridgecast::testing_support
