#pragma once
// The sides of a box, each divided as a line, so that adjoining boxes share it to the bit.

#include <vector>

#include "common/terrain/terrain.h"
#include "server/box/samples.h"

namespace ridgecast::box {

struct Side {
  triangulation::Point2 from, to;  // along x or z
  double error;                    // metres
  int vertical;                    // the spacing of vertices' heights, as a power of two in steps
};

// Points between its ends with which the terrain along it stays within the error of straight lines (Douglas and Peucker 1973). Depends on
// the two ends alone, not on which comes first.
std::vector<triangulation::Point2> divided(const terrain::Terrain& terrain, const Frame& frame, const Side& side);

}  // namespace ridgecast::box
