#pragma once
// A triangle's candidate: the point of the true terrain that would improve the mesh most there, chosen once, when the triangle is
// made. It depends on the camera only where a view looks closely.
//
// Several points of a triangle are tried (its centroid and one towards each corner, so that a bump beside the middle is seen), snapped
// to the lattice of the leaf's level, and the one with the largest vertical error is kept. A snapped point outside its triangle or on
// a corner is no candidate. The thesis's metric tries one point only: 0.6 of the way from the centroid to the corners' average
// weighted by curvature (Cavallin and Pettersson 2019, figure 3.17).
//
// Few points miss what is narrow, ridges and walls. A view that looks closely (View::closely) tries points all over the triangle in the directions that
// it draws, and keeps the one whose error it sees most of. Ground narrower than the distance between those points may still be missed.

#include <algorithm>
#include <cstdint>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "server/refinement/surface.h"
#include "server/triangulation/triangulation.h"

namespace ridgecast::refinement {

struct View;

// The height, in steps, of the plane through three vertices, and of a triangle's plane, at a point.
double planeHeight(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c, triangulation::Point2 p);
// The fourth root of a triangle's area in square steps, its weight for kArea.
double areaWeight(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c);
double heightOnTriangle(const triangulation::Triangulation& mesh, triangulation::TriangleId t, triangulation::Point2 p);

struct HeightRange {  // steps
  std::int32_t low = lattice::kMaxHeight, high = -lattice::kMaxHeight;
  void add(const HeightRange& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
};

// Chooses the candidates of a region's fresh triangles, hashes them, and marks them seen. `level` is the leaf's. With the view of the last
// screening their pages' bounds learn of them; without, the pages are screened anew. Different regions may be evaluated at the same time.
// `ground`: what heights the region is known to have; learns of those evaluated. Returns how many.
std::uint64_t evaluateFresh(triangulation::Triangulation& mesh, Surface& surface, const terrain::Terrain& terrain,
                            triangulation::RegionId region, int level, Metric metric, const View* view, HeightRange& ground);

}  // namespace ridgecast::refinement
