#pragma once
// What refinement keeps beside the triangulation's records: candidates by triangle, true heights and losses by vertex, and by page and by
// region what the last screening found, so that the next ones can be spared while the camera stays near (screening.h, coarsening.h).
//
// Arrays are indexed as the mesh's are and grow resident with it. All positions in steps relative to the mesh's anchor, heights in steps,
// absolute. Threads: as the triangulation; what belongs to a region is touched by one thread at a time.

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "server/triangulation/triangulation.h"

namespace ridgecast::refinement {

// Where slots without a candidate lie, so that they are nobody's nearest; steps, its square's square fits a float.
inline constexpr std::int32_t kFarAway = 1 << 29;
enum class Metric { kPixels, kArea, kThesis };  // see screening.h

inline constexpr double kAlways = -std::numeric_limits<double>::infinity();  // due whatever the camera has done

// The candidates of a page of triangles, so that screening reads one run of memory. A triangle without one has error 0.
struct alignas(64) CandidatePage {
  static constexpr std::uint32_t kSlots = triangulation::TrianglePages::kSlots;
  std::int32_t x[kSlots], z[kSlots];
  std::int32_t y[kSlots];  // the terrain's height there, to the step (not snapped to a level)
  float error[kSlots];     // steps: |mesh - snapped terrain|, for kArea times the triangle's weight; negative: asleep
};

// When a page is looked at again: when the camera has travelled, or turned so far. Apart from what the page is judged by, for every iteration
// looks at all of these.
struct PageDue {
  double travel = kAlways, turn = kAlways;
};

struct alignas(64) PageScreen {
  double travel = -1;                             // of the camera when the bounds held; negative: there are none, look again
  float steepest = 0;                             // of the candidates awake the largest error / distance,
  float seen = 0;                                 // and error x horizontal distance / distance^2, which is what is seen of it
  float nearest = 0;                              // steps: smallest distance of any candidate
  float sleepsFor = 0;                            // steps: the way since then after which the first of those asleep wakes
  triangulation::TrianglePages::Mask asleep = 0;  // candidates wanted but not worth it for now; their error is kept negative meanwhile
  triangulation::TrianglePages::Mask blank = 0;   // dead slots that hold no candidate, far away
  double sleptTravel = 0;                         // when the first of those asleep fell asleep

  // The page's share of its region's hash, here because whoever makes a triangle writes both.
  std::uint64_t hash = 0;  // sum over the slots in `hashed` of what Surface::hash holds for them
  triangulation::TrianglePages::Mask hashed = 0;
};
static_assert(sizeof(PageScreen) == 64);

// As PageScreen, for the losses of a page of vertices.
struct PageLosses {
  double due = kAlways;
  double travel = -1;
  float leastSlope = 0;         // of any vertex that was not to go: loss as seen, pixels / pixels per radian
  float flat = 0, nearest = 0;  // steps: smallest horizontal and smallest distance
};

// The earliest of a region's pages, valid for the limit that it was made for.
struct alignas(64) RegionScreen {
  PageDue due;
  double spared = 1;  // error / distance
  double lossesDue = kAlways;
  double lossesSpared = 1;
};

struct VertexExtra {
  std::uint64_t mixed;      // the vertex's part of its triangles' hashes (common/mesh)
  float loss;               // steps: the error that removing it made when last looked at; infinite: a grid point, which stays
  std::int32_t fineY : 27;  // the terrain's height to the step; the mesh's vertex is snapped
  std::uint32_t level : 5;  // the level that the mesh's vertex is snapped to
};
static_assert(sizeof(VertexExtra) == 16 && lattice::kMaxHeight < (1 << 26));

struct Surface {
  // `thesis`: curvatures are kept too.
  Surface(std::uint32_t triangleCapacity, std::uint32_t vertexCapacity, bool thesis);

  // by triangle
  triangulation::Records<CandidatePage> candidates;  // by page
  triangulation::Records<std::uint64_t> hash;        // the triangle's term of its leaf's hash (common/mesh)
  std::unique_ptr<PageDue[]> dues;                   // by page of triangles
  std::unique_ptr<PageScreen[]> screens;             // by page of triangles
  std::unique_ptr<PageLosses[]> losses;              // by page of vertices
  std::vector<RegionScreen> regions;                 // by region; as long as the largest id needs

  // by vertex
  triangulation::Records<VertexExtra> vertices;
  triangulation::Records<float> curvature;  // metres; of no length unless kept

  lattice::Point anchor;  // absolute steps; a multiple of the coarsest leaf's side

  static constexpr std::size_t kBytesPerTrianglePage =
      sizeof(CandidatePage) + triangulation::TrianglePages::kSlots * sizeof(std::uint64_t) + sizeof(PageDue) + sizeof(PageScreen);
  static constexpr std::size_t kBytesPerVertexPage = triangulation::VertexPages::kSlots * sizeof(VertexExtra) + sizeof(PageLosses);

  struct Candidate {
    triangulation::Point2 point;
    std::int32_t y;
    float error;  // as in CandidatePage
  };
  Candidate candidate(std::uint32_t t) const {
    const CandidatePage& page = candidates[t / CandidatePage::kSlots];
    const std::uint32_t k = t % CandidatePage::kSlots;
    return {{page.x[k], page.z[k]}, page.y[k], page.error[k]};
  }
  void prefetchCandidate(std::uint32_t t) const {
    const CandidatePage& page = candidates[t / CandidatePage::kSlots];
    const std::uint32_t k = t % CandidatePage::kSlots;
    __builtin_prefetch(&page.x[k], 1);
    __builtin_prefetch(&page.z[k], 1);
    __builtin_prefetch(&page.y[k], 1);
    __builtin_prefetch(&page.error[k], 1);
    __builtin_prefetch(&screens[t / CandidatePage::kSlots], 1);
    __builtin_prefetch(&dues[t / CandidatePage::kSlots], 1);
  }
  // What belongs to a page of vertices.
  void prefetchVertices(std::uint32_t page) const {
    const char* const first = reinterpret_cast<const char*>(&vertices[page * triangulation::VertexPages::kSlots]);
    for (std::size_t k = 0; k < triangulation::VertexPages::kSlots * sizeof(VertexExtra); k += 64) __builtin_prefetch(first + k);
  }
  // The candidate of a new triangle, awake. The page's bounds do not know it yet: see foldCandidate() in screening.h.
  void setCandidate(std::uint32_t t, const Candidate& c) {
    CandidatePage& page = candidates[t / CandidatePage::kSlots];
    const std::uint32_t k = t % CandidatePage::kSlots;
    page.x[k] = c.point.x;
    page.z[k] = c.point.z;
    page.y[k] = c.y;
    page.error[k] = c.error;
    PageScreen& screen = screens[t / CandidatePage::kSlots];
    const triangulation::TrianglePages::Mask bit = triangulation::TrianglePages::Mask{1} << k;
    screen.asleep &= ~bit;
    screen.blank &= ~bit;
  }
  // The triangle's term; what the slot held before leaves the page's sum.
  void setHash(std::uint32_t t, std::uint64_t term) {
    PageScreen& page = screens[t / CandidatePage::kSlots];
    const triangulation::TrianglePages::Mask bit = triangulation::TrianglePages::Mask{1} << (t % CandidatePage::kSlots);
    if (page.hashed & bit) page.hash -= hash[t];
    page.hash += term;
    page.hashed |= bit;
    hash[t] = term;
  }
  // Nothing is in the page yet that its bounds must hold for. What its former region left there is forgotten: which pages a region gets depends on
  // threads, and what is done next may not.
  void beginScreen(std::uint32_t page, double travel) {
    constexpr double never = std::numeric_limits<double>::infinity();
    PageScreen& screen = screens[page];
    dues[page] = {never, never};
    screen = {travel, 0, 0, std::numeric_limits<float>::max(), 0, 0, screen.blank, 0, screen.hash, screen.hashed};
  }
  void beginLosses(std::uint32_t page) { losses[page] = {}; }
  // The page of a candidate, of a vertex is looked at again whatever is known of it.
  void wakeCandidate(std::uint32_t t, triangulation::RegionId region) {
    screens[t / CandidatePage::kSlots].travel = -1;
    dues[t / CandidatePage::kSlots].travel = regions[region].due.travel = kAlways;
  }
  void wakeVertex(std::uint32_t v, triangulation::RegionId region) {
    PageLosses& page = losses[v / triangulation::VertexPages::kSlots];
    page.travel = -1;
    page.due = regions[region].lossesDue = kAlways;
  }
  // What is kept of records follows them to their new ids, all of which lie in `region`. Best page by page: what a page has is then written
  // once, while other threads may write its neighbours in the same line of the cache.
  void moveTriangles(std::span<const triangulation::Move> moves, triangulation::RegionId region);
  void moveVertices(std::span<const triangulation::Move> moves, triangulation::RegionId region);
  bool keepsCurvature;
};

// The region's hash (common/mesh): the sum over its triangles, of which only what changed is summed again.
std::uint64_t hashRegion(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region);

}  // namespace ridgecast::refinement
