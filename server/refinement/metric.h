#pragma once
// The metrics: how the error of a candidate or a vertex is measured for a camera. Everything that tells them apart, except names and limits
// (common/settings).
//
// kPixels  distance on screen, in pixels, between the candidate on the mesh and on the terrain, measured where the camera looks straight at
//          it: error x cos(elevation) x pixels per radian / distance. It does not depend on the camera's direction, so turning causes no
//          thrashing.
// kArea    the same times the fourth root of the triangle's area in square pixels, seen face on at the candidate's distance: an error that
//          covers more of the picture counts for more. The fewest triangles for a picture; no promise about any one pixel.
// kThesis  (area in normalised device coordinates)^0.5 x 40 x (distance in normalised device coordinates), Cavallin and Pettersson 2019,
//          algorithm 6, with the constants of their published program. A triangle that reaches behind the camera counts as large as the
//          picture. CandidateStore::findByThesis() measures it.

#include <array>
#include <cmath>

#include "common/settings/settings.h"
#include "server/refinement/records.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

using settings::Metric;

// kPixels and kArea: gain() x error x weight x horizontal distance / (distance x reach(distance)) is seen; error and distances in steps.
struct Measure {
  bool byArea;
  explicit Measure(Metric metric) : byArea(metric == Metric::kArea) {}

  double power() const { return byArea ? 1.5 : 1; }
  // distance^(power() - 1), and distance^power(); of squares the squares.
  template <class T>
  T rise(T distance) const {
    return byArea ? std::sqrt(distance) : T{1};
  }
  template <class T>
  T reach(T distance) const {
    return distance * rise(distance);
  }
  double gain(double pixelsPerRadian) const { return reach(pixelsPerRadian); }
  // Of a triangle, by its area in square steps.
  double weight(double area) const { return byArea ? std::sqrt(std::sqrt(area)) : 1; }
};

struct Eye {
  std::int32_t x, z;
  float y, gain2, least;  // gain and threshold, squared
};
struct PageLook {
  PageScreen::Mask wanted;           // whose error as seen reaches the threshold
  float steepest2, seen2, nearest2;  // as PageScreen's, squared, of the candidates not wanted
};
// The candidates of a page: the first of each of its blocks; null where it has no block. Dead slots are blank.
using PageCandidates = std::array<const Candidates*, triangulation::TrianglePages::kBlocks>;
PageLook lookThrough(const Measure& measure, const PageCandidates& page, const Eye& eye);

}  // namespace ridgecast::refinement
