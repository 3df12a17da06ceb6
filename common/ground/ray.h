#pragma once

#include "common/lattice/lattice.h"

namespace ridgecast::ground {

// Where a ray begins, where it points and how far it reaches.
struct Ray {
  lattice::Step x = 0, z = 0;                             // steps
  double y = 0;                                           // metres
  double directionX = 0, directionY = 0, directionZ = 0;  // of any length but 0
  double reach = 0;                                       // metres
};

}  // namespace ridgecast::ground
