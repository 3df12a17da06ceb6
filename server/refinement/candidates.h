#pragma once
// A triangle's candidate: the point of the true terrain that would improve the mesh most there, chosen once, when the triangle is
// made. It does not depend on the camera.
//
// Several points of a triangle are tried (its centroid and one towards each corner, so that a bump beside the middle is seen), snapped
// to the lattice of the leaf's level, and the one with the largest vertical error is kept. A snapped point outside its triangle or on
// a corner is no candidate. The thesis's metric tries one point only: 0.6 of the way from the centroid to the corners' average
// weighted by curvature (Cavallin and Pettersson 2019, figure 3.17).

#include <cstdint>

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

// Chooses the candidates of a region's fresh triangles, hashes them, and marks them seen. `level` is the leaf's. With the view of the last
// screening their pages' bounds learn of them; without, the pages are screened anew. Returns how many heights were evaluated. Different
// regions may be evaluated at the same time.
std::uint64_t evaluateFresh(triangulation::Triangulation& mesh, Surface& surface, const terrain::Terrain& terrain,
                            triangulation::RegionId region, int level, Metric metric, const View* view);

}  // namespace ridgecast::refinement
