#pragma once
// An independent check of a terrain mesh given leaf by leaf: it sees lattice positions only and shares nothing with the triangulation,
// the client or the exporter.

#include <string>
#include <vector>

#include "common/mesh/leaf_mesh.h"

namespace ridgecast::testing_support {

struct MeshReport {
  std::size_t leaves = 0, vertices = 0, triangles = 0, interiorEdges = 0;
  std::size_t heights = 0;       // points that carry two heights
  std::size_t clockwise = 0;     // triangles not counter-clockwise seen from above
  std::size_t overused = 0;      // directed edges used twice: an overlap or a duplicate
  std::size_t misfiled = 0;      // triangles whose centroid is not in their leaf's square
  std::size_t cracks = 0;        // holes, slits and overlaps along them, except single triangles whose centroid lies in no leaf
  std::size_t notDelaunay = 0;   // interior edges with the opposite corner strictly inside the circle, exactly
  std::size_t notCanonical = 0;  // cocircular edges that do not hold the smallest of the four corners
  bool clean() const { return triangles > 0 && heights + clockwise + overused + misfiled + cracks + notDelaunay + notCanonical == 0; }
  std::string text() const;
};

MeshReport checkMesh(const std::vector<mesh::LeafMesh>& leaves);

}  // namespace ridgecast::testing_support
