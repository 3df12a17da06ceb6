#pragma once

#include "common/lattice/lattice.h"

namespace ridgecast::ground {

// Origin, direction and reach of a ray.
struct Ray {
  lattice::Step x = 0, z = 0;                             // steps
  double y = 0;                                           // metres
  double directionX = 0, directionY = 0, directionZ = 0;  // of any length but 0
  double reach = 0;                                       // metres
};

}  // namespace ridgecast::ground
