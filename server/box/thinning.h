#pragma once
// Removes vertices that the error does not need: what greedy insertion put in early may have been overtaken by what came later, and points
// that were inserted side by side may do without one another.

#include <cstddef>

#include "common/triangulation/triangulation.h"
#include "server/box/judge.h"
#include "server/box/regions.h"

namespace ridgecast::box {

// Those of one region, the ones that the surface misses least first; vertices of the hull stay. `worst` holds the verdict of each triangle,
// also of those that come in their place. `error` in metres. Writes the region and its neighbours; any thread.
void thin(triangulation::Triangulation& mesh, const Regions& regions, std::size_t home, const Judge& judge, float error, Worst* worst);

}  // namespace ridgecast::box
