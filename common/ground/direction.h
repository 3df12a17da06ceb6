#pragma once
// Internal to the room: where a ray goes.

#include <algorithm>
#include <cmath>

#include "common/ground/ground.h"
#include "common/outcome/contract.h"

namespace ridgecast::ground {

struct Direction {
  double x = 0, y = 0, z = 0;  // of length 1
};

inline Direction directionOf(const Ray& ray) {
  // Scaled before squaring, so that every finite length has a direction.
  const double most = std::max({std::abs(ray.directionX), std::abs(ray.directionY), std::abs(ray.directionZ)});
  expects(most > 0 && std::isfinite(most), "a ray has a direction");
  expects(std::isfinite(ray.reach), "a ray ends");
  const double x = ray.directionX / most, y = ray.directionY / most, z = ray.directionZ / most;
  const double length = std::sqrt(x * x + y * y + z * z);
  return {x / length, y / length, z / length};
}

}  // namespace ridgecast::ground
