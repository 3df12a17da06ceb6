#pragma once
// A triangle's candidate: the point of the true terrain that would improve the mesh most there, chosen once, when the triangle is
// made. It does not depend on the camera.
//
// Several points of a triangle are tried (its centroid and one towards each corner, so that a bump beside the middle is seen), snapped
// to the lattice of the leaf's level, and the one with the largest vertical error is kept. A snapped point outside its triangle or on
// a corner is no candidate. The thesis's metric tries one point only: 0.6 of the way from the centroid to the corners' average
// weighted by curvature (Cavallin and Pettersson 2019, figure 3.17).
//
// Arrays are indexed by triangle, so that screening (screening.h) is a straight pass over a region's pages.

#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "server/triangulation/triangulation.h"

namespace ridgecast::refinement {

// What the last screening of a page of triangles found, so that the next ones can be spared while the camera stays near (screening.h).
struct PageScreen {
  double travel = -1;               // of the camera at that screening, steps; negative: something is new, look again
  float steepest = 0;               // largest error / distance of the candidates awake
  float nearest = 0;                // steps: smallest distance of any candidate
  std::uint64_t asleep = 0;         // candidates wanted but not worth it for now; their error is kept negative meanwhile
  std::uint64_t blank = 0;          // dead slots whose arrays hold no candidate, far away
  double sleptTravel = 0, sleptTurn = 0;  // when the first of them fell asleep
};

// A page of triangles' share of its region's hash.
struct PageHash {
  std::uint64_t hash = 0;           // sum over the triangles of the page, while `hashed` is what is alive
  std::uint64_t hashed = 0;
  bool rehash = true;               // a triangle of the page is new
};

// As PageScreen, for a page of vertices and their losses (coarsening.h).
struct PageLosses {
  double travel = -1;
  float leastPixels = 0;            // of any vertex not appended
  float flat = 0, nearest = 0;      // steps: smallest horizontal and smallest distance
};

// What is kept beside the mesh's own records. All positions in steps relative to the mesh's anchor, heights in steps, absolute.
struct Surface {
  Surface(std::uint32_t triangleCapacity, std::uint32_t vertexCapacity);

  // by triangle
  std::unique_ptr<std::int32_t[]> x, z;     // the candidate; valid where error > 0
  std::unique_ptr<std::int32_t[]> y;        // the terrain's height there, to the step (not snapped to a level)
  std::unique_ptr<float[]> error;           // steps: |mesh - snapped terrain| at the candidate; 0: no candidate; negative: asleep
  std::unique_ptr<std::uint64_t[]> hash;    // the triangle's term of its leaf's hash (common/mesh)

  std::unique_ptr<PageScreen[]> screens;    // by page of triangles
  std::unique_ptr<PageHash[]> hashes;       // by page of triangles
  std::unique_ptr<PageLosses[]> losses;     // by page of vertices

  // by vertex
  std::unique_ptr<std::int32_t[]> fineY;    // the terrain's height to the step; the mesh's vertex is snapped
  std::unique_ptr<std::uint8_t[]> level;    // the level that the mesh's vertex is snapped to
  std::unique_ptr<std::uint64_t[]> mixed;   // the vertex's part of its triangles' hashes (common/mesh)
  std::unique_ptr<float[]> curvature;       // metres; only kept for the thesis's metric
  std::unique_ptr<float[]> loss;            // steps: the error that removing it made when last looked at (coarsening.h); infinite: a
                                            // grid point, which stays

  lattice::Point anchor;                    // absolute steps; a multiple of the coarsest leaf's side

  static constexpr std::size_t kBytesPerTrianglePage =
      triangulation::Pages::kSlots * (3 * sizeof(std::int32_t) + sizeof(float) + sizeof(std::uint64_t)) + sizeof(PageScreen) + sizeof(PageHash);
  static constexpr std::size_t kBytesPerVertexPage =
      triangulation::Pages::kSlots * (sizeof(std::int32_t) + sizeof(std::uint8_t) + sizeof(std::uint64_t) + 2 * sizeof(float)) + sizeof(PageLosses);

  // A triangle has a new candidate, a vertex a new loss: their pages' screenings no longer hold.
  void renewTriangle(std::uint32_t t) {
    PageScreen& page = screens[t / triangulation::Pages::kSlots];
    page.travel = -1;
    hashes[t / triangulation::Pages::kSlots].rehash = true;
    const std::uint64_t bit = std::uint64_t{1} << (t % triangulation::Pages::kSlots);
    page.asleep &= ~bit;
    page.blank &= ~bit;
  }
  void setLoss(std::uint32_t v, float steps) {
    loss[v] = steps;
    losses[v / triangulation::Pages::kSlots].travel = -1;
  }
  void moveTriangle(std::uint32_t from, std::uint32_t to) {
    // A candidate that moves is awake.
    x[to] = x[from];
    z[to] = z[from];
    y[to] = y[from];
    error[to] = std::abs(error[from]);
    hash[to] = hash[from];
    renewTriangle(to);
  }
  void moveVertex(std::uint32_t from, std::uint32_t to) {
    fineY[to] = fineY[from];
    level[to] = level[from];
    mixed[to] = mixed[from];
    curvature[to] = curvature[from];
    setLoss(to, loss[from]);
  }
};

// The region's hash (common/mesh): the sum over its triangles, of which only pages that changed are summed again.
std::uint64_t hashRegion(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region);

// The height, in steps, of the plane through three vertices, and of a triangle's plane, at a point.
double planeHeight(const triangulation::Vertex& a, const triangulation::Vertex& b, const triangulation::Vertex& c, triangulation::Point2 p);
double heightOnTriangle(const triangulation::Triangulation& mesh, triangulation::TriangleId t, triangulation::Point2 p);

// Chooses the candidates of a region's fresh triangles, hashes them, and marks them seen. `level` is the leaf's. Returns how many heights were
// evaluated. Different regions may be evaluated at the same time.
std::uint64_t evaluateFresh(triangulation::Triangulation& mesh, Surface& surface, const terrain::Terrain& terrain, triangulation::RegionId region,
                            int level, bool thesis);

}  // namespace ridgecast::refinement
