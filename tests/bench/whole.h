#pragma once
// One region that is all of the plane.

#include "common/triangulation/triangulation.h"

namespace ridgecast::bench {

class Whole : public triangulation::Partition {
 public:
  triangulation::RegionId regionAt(triangulation::Point2) const override { return region; }
  triangulation::RegionId region = triangulation::kOutside;
};

}  // namespace ridgecast::bench
