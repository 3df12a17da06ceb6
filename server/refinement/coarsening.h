#pragma once
// Which vertices no longer earn their place.
//
// A vertex goes when everything that its removal would spoil stays small on screen: its own height against the surface without it, and
// the known candidates of its star against that surface. (Its own error alone is not enough: vertices that hold up their neighbours'
// candidates would come and go for ever.) The largest of these is its *loss*, a vertical error that does not depend on the camera. The
// loss last seen is kept as a filter: only vertices that pass with it are looked at again, and those that then fail remember why.
// Screening spares pages and regions as screenPixels does; a vertex appended is told once: who neither removes it nor folds its new loss
// says so by Surface::wakeVertex.
//
// The limit is half the threshold at which vertices are inserted, so nothing flickers.

#include <vector>

#include "server/refinement/screening.h"

namespace ridgecast::refinement {

// Appends the region's vertices whose remembered loss is below `limit` pixels where they are, in the order of storage. None of a page's
// other vertices can come below it while
//     leastSlope (1 - m / flat) / (1 + m / nearest)^(p + 1) > limit / gain,
// for which leastSlope (1 - m (1 / flat + (p + 1) / nearest)) is enough; p as in screening.h.
void screenLosses(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view,
                  double limit, std::vector<triangulation::VertexId>& out);

struct Place {  // steps, y absolute
  std::int32_t x, z, y;
};

// Notes a vertex's loss, and its page's bounds learn of it.
void foldLoss(const triangulation::Vertex& p, triangulation::VertexId v, float loss, triangulation::RegionId region, const View& view,
              Surface& surface);

// The loss in steps, times the weight of the triangle where `area`, by a plan for the removal that stays in `set` for apply(). Infinite where the vertex cannot go now: it lies on the
// hull or beside a triangle without a candidate yet, or its star leaves the write set.
float lossOf(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::VertexId v, bool area,
             triangulation::WriteSet& set);

// What a vertical error at a point comes to on the screen, as in screenPixels. For kArea, `error` includes the area's weight. All in steps.
double measure(const Place& at, float error, const View& view);

}  // namespace ridgecast::refinement
