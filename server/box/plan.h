#pragma once
// What follows from a box before its samples are taken: area, units, spacings.

#include <array>
#include <cstdint>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/predicates.h"
#include "server/box/box_mesh.h"
#include "server/box/samples.h"

namespace ridgecast::box {

struct Plan {
  double error;              // metres, as promised
  double noise = 0;          // metres of it that a formula's rounding may take between samples, as measured; at most a quarter
  float kept = 0;            // the rest: the limit for samples, rounded down so that all comparisons agree
  std::uint32_t most;        // triangles
  int vertical = 0;          // spacing of vertices' heights, as a power of two in steps
  lattice::Point low, high;  // the box, widened
  Frame frame;
  std::uint64_t samples;                         // at most
  int bits = 0;                                  // of the first samples, as a power of two in units
  std::array<triangulation::Point2, 4> corners;  // of the box, counter-clockwise from the lowest

  Plan(const Box& box, const terrain::Terrain& terrain, std::uint32_t mostTriangles);
};

}  // namespace ridgecast::box
