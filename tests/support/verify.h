#pragma once
// A full check of a triangulation that shares nothing with the code that maintains it: no predicate, no link, no count of its own.
// Slow (a hash map of edges, 128-bit arithmetic); for tests and the soak.

#include <string>

#include "common/triangulation/triangulation.h"
#include "server/generation/camera_mesh.h"

namespace ridgecast::testing_support {

// Empty when everything holds; otherwise what does not, and where, one line each (at most 20). Checked:
//   every finite triangle counter-clockwise; every directed edge used once and its twin link mutual; ghosts exactly on the hull and
//   the hull convex; one connected piece without holes (Euler); every edge locally Delaunay by exact arithmetic, ties keeping the
//   diagonal with the smallest point; every triangle and vertex filed under the partition's region; every vertex's edge starts at it.
std::string verify(const triangulation::Triangulation& mesh, const triangulation::Partition& partition);

// And whether every leaf's grid is in the mesh, and exactly the grids' points are fixed.
std::string verify(const generation::CameraMesh& camera);

}  // namespace ridgecast::testing_support
