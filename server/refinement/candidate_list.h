#pragma once
// The candidates of a region as a person may want to see them. Reads alone; regions may be read at the same time.

#include <cstdint>
#include <vector>

#include "server/refinement/screening.h"
#include "server/refinement/surface.h"

namespace ridgecast::refinement {

struct ListedCandidate {
  triangulation::Point2 point;
  std::int32_t y;  // steps: the terrain's height there
  float pixels;    // between it and the mesh, as kPixels measures, whatever the metric

  // The worst first; a total order that depends on values only.
  friend bool operator<(const ListedCandidate& a, const ListedCandidate& b) {
    if (a.pixels != b.pixels) return a.pixels > b.pixels;
    return triangulation::smaller(a.point, b.point);
  }
};

// Appends those whose triangle, or the ground over it, the view's wide frustum may see, in any order. Without those that screening has put to sleep: what other ground hides, and specks.
void listCandidates(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::RegionId region, const View& view,
                    std::vector<ListedCandidate>& out);

// Keeps the worst `most`, sorted.
void keepWorst(std::vector<ListedCandidate>& candidates, std::size_t most);

}  // namespace ridgecast::refinement
