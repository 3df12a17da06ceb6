#pragma once
// What refinement keeps beside the triangulation's records: a candidate for each triangle, a height and a loss for each vertex, and what
// the last look at a page found (bounds.h says why).
//
// Positions are in steps relative to the mesh's anchor, heights in steps, absolute.

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::refinement {

using PageList = std::vector<std::uint32_t>;

// Where slots without a candidate lie, so that they are never nearest; steps, and its fourth power fits a float.
inline constexpr std::int32_t kFarAway = 1 << 29;
inline constexpr double kAlways = -std::numeric_limits<double>::infinity();  // a next check that is always due

struct HeightRange {  // steps
  std::int32_t low = lattice::kMaxHeight, high = -lattice::kMaxHeight;
  void add(const HeightRange& other) {
    low = std::min(low, other.low);
    high = std::max(high, other.high);
  }
};

struct Candidate {
  triangulation::Point2 point;
  std::int32_t y;  // the terrain's height there, to the step (not snapped to a level)
  float error;     // steps: |mesh - snapped terrain|, for kArea times the triangle's weight; negative: dormant; 0: there is no candidate
};

// The candidates of four triangles: a line of the cache. Those of a block lie together.
struct alignas(64) Candidates {
  static constexpr std::uint32_t kSlots = 4;
  std::int32_t x[kSlots], z[kSlots], y[kSlots];
  float error[kSlots];
};
static_assert(sizeof(Candidates) == 64);

// A page is checked again once the camera has travelled or turned this far. Stored separately: every iteration scans all of these.
struct NextCheck {
  double travel = kAlways, turn = kAlways;
};

struct alignas(64) PageScreen {
  using Mask = triangulation::TrianglePages::Mask;
  double travel = -1;       // of the camera when the bounds held; negative: there are none
  float steepest = 0;       // of the candidates not wanted: the largest error / distance,
  float seen = 0;           // the largest error x horizontal distance / distance^2, which is what is seen of it,
  float nearest = 0;        // and the smallest distance of any candidate, steps
  float dormantFor = 0;     // steps from dormantSince on, after which the first dormant candidate wakes
  Mask dormant = 0;         // their errors are kept negative
  Mask blank = 0;           // dead slots that hold no candidate, far away
  double dormantSince = 0;  // travel when the first of them became dormant

  // The page's share of its region's hash, here because whatever makes a triangle writes both.
  std::uint64_t hash = 0;  // sum of the terms of the slots in `hashed`
  Mask hashed = 0;
};
static_assert(sizeof(PageScreen) == 64);

// As PageScreen, for the losses of a page of vertices.
struct PageLosses {
  double nextCheck = kAlways;
  double travel = -1;
  float leastSlope = 0;         // of any vertex that was to stay: loss as seen, pixels / pixels per radian
  float flat = 0, nearest = 0;  // steps: smallest horizontal and smallest distance
};

struct alignas(64) RegionState {
  // The earliest of the region's pages, valid for the limit that it was made for.
  NextCheck nextCheck;
  double skipped = 1;  // error / distance
  double nextLossCheck = kAlways;
  double skippedLoss = 1;
  HeightRange ground;  // that was seen there
  std::int32_t level = 0;
};
static_assert(sizeof(RegionState) == 64);

struct VertexExtra {
  float loss;               // steps: the error that removing it made when last looked at; infinite: the vertex is fixed
  std::int32_t fineY : 27;  // the terrain's height to the step; the mesh's vertex is snapped
  std::uint32_t level : 5;  // that the mesh's vertex is snapped to
};
static_assert(sizeof(VertexExtra) == 8 && lattice::kMaxHeight < (1 << 26));

// visit(page, run) for every run of moves to one page.
template <class Storage, class F>
void forEachPage(const Storage& pages, std::span<const triangulation::Move> moves, F&& visit) {
  while (!moves.empty()) {
    const std::uint32_t page = pages.pageOf(moves.front().to);
    const auto end = std::find_if(moves.begin(), moves.end(), [&](const auto& move) { return pages.pageOf(move.to) != page; });
    const auto count = static_cast<std::size_t>(end - moves.begin());
    visit(page, moves.first(count));
    moves = moves.subspan(count);
  }
}

// A wanted candidate.
struct Pending {
  triangulation::TriangleId triangle;
  triangulation::Point2 point;
  float priority;  // the greater the earlier

  // A total order that depends on values only.
  friend bool operator<(const Pending& a, const Pending& b) {
    if (a.priority != b.priority) return a.priority > b.priority;
    return triangulation::smaller(a.point, b.point);
  }
};

// What one iteration finds to do in a region, and what it did. Empty between iterations.
struct Work {
  double removalLimit = 0;                         // pixels of loss below which vertices go
  std::vector<Pending> pending;                    // sorted
  std::vector<triangulation::VertexId> removable;  // in the order of storage
  std::uint32_t inserted = 0, removed = 0;
  std::vector<Pending> deferred;  // their changes would have left the write set

  bool isEmpty() const { return pending.empty() && removable.empty(); }
  // Clears finished work and frees large lists: a mesh made from nothing has them in every region.
  void end() {
    const auto empty = [](auto& list) {
      list.clear();
      if (list.capacity() > 16) list.shrink_to_fit();
    };
    empty(pending);
    empty(removable);
    empty(deferred);
    inserted = removed = 0;
  }
};

}  // namespace ridgecast::refinement
