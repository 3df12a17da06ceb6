#pragma once
// Geometry of one triangle of the mesh. Steps.

#include <algorithm>
#include <cassert>
#include <cmath>

#include "common/lattice/lattice.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::refinement {

// How much the second and the third of three vertices count at a point of their plane.
struct Weights {
  double b, c;
};
inline Weights weightsAt(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c,
                         triangulation::Point2 p) {
  const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, cx = double(c.x) - a.x, cz = double(c.z) - a.z, px = double(p.x) - a.x,
               pz = double(p.z) - a.z;
  const double area = bz * cx - bx * cz;
  assert(area > 0);
  return {(pz * cx - px * cz) / area, (bz * px - bx * pz) / area};
}
// The height at a point of the plane through three vertices.
inline double planeHeight(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c,
                          triangulation::Point2 p) {
  const Weights w = weightsAt(a, b, c, p);
  return a.y + w.b * (double(b.y) - a.y) + w.c * (double(c.y) - a.y);
}
inline double heightOnTriangle(const triangulation::Triangulation& mesh, triangulation::TriangleId t, triangulation::Point2 p) {
  const auto& v = mesh.triangle(t).v;
  return planeHeight(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]), p);
}

// In square steps.
inline double areaOf(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c) {
  const double bx = double(b.x) - a.x, bz = double(b.z) - a.z, by = double(b.y) - a.y, cx = double(c.x) - a.x, cz = double(c.z) - a.z,
               cy = double(c.y) - a.y;
  const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
  return 0.5 * std::sqrt(nx * nx + ny * ny + nz * nz);
}
inline double areaOf(const triangulation::Triangulation& mesh, triangulation::TriangleId t) {
  const auto& v = mesh.triangle(t).v;
  return areaOf(mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]));
}

// Absolute; it holds the corners.
inline lattice::Area boxOf(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c,
                           lattice::Point anchor) {
  return {anchor.x + std::min({a.x, b.x, c.x}), anchor.z + std::min({a.z, b.z, c.z}), anchor.x + std::max({a.x, b.x, c.x}) + 1,
          anchor.z + std::max({a.z, b.z, c.z}) + 1};
}

}  // namespace ridgecast::refinement
