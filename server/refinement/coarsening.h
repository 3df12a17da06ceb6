#pragma once
// Which vertices no longer earn their place.
//
// A vertex goes when everything that its removal would spoil stays small on screen: its own height against the surface without it, and
// the known candidates of its star against that surface. (Its own error alone is not enough: vertices that hold up their neighbours'
// candidates would come and go for ever.) The largest of these is its *loss*, a vertical error that does not depend on the camera. The
// loss last seen is kept as a filter: only vertices that pass with it are looked at again, and those that then fail remember why.
// The limit is half the threshold at which vertices are inserted, so nothing flickers.

#include <vector>

#include "server/refinement/screening.h"

namespace ridgecast::refinement {

// Appends the region's vertices whose remembered loss is below `limit` pixels where they are, in the order of storage. Pages are spared
// as in screenPixels: none of a page's vertices can come below the limit while
//     leastPixels * (1 - m / flat) / (1 + m / nearest)^2 > limit.
void screenLosses(const triangulation::Triangulation& mesh, Surface& surface, triangulation::RegionId region, const View& view,
                  double limit, std::vector<triangulation::VertexId>& out);

// The loss in steps, by a plan for the removal that stays in `set` for apply(). Infinite where the vertex cannot go now: it lies on the
// hull or beside a triangle without a candidate yet, or its star leaves the write set.
float lossOf(const triangulation::Triangulation& mesh, const Surface& surface, triangulation::VertexId v, triangulation::WriteSet& set);

// Pixels that a vertical error of so many steps at a vertex covers, as in screenPixels.
double pixelsAt(const triangulation::Vertex& v, double error, const View& view);

}  // namespace ridgecast::refinement
