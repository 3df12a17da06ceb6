#pragma once
// Removes vertices that the error does not need: later insertions may have made early ones redundant, and points inserted side by side may
// not need one another.

#include <cstddef>

#include "common/triangulation/triangulation.h"
#include "server/box/judge.h"
#include "server/box/regions.h"

namespace ridgecast::box {

// Thins one region, the vertices that the surface misses least first; vertices of the hull stay. `worst` holds the verdict of each
// triangle, including the replacements. `error` in metres. Writes the region and its neighbours; any thread.
void thin(triangulation::Triangulation& mesh, const Regions& regions, std::size_t home, const Judge& judge, float error, Worst* worst);

}  // namespace ridgecast::box
