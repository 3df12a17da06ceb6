#pragma once
// What lies under a brush, of the mesh that is held.

#include <optional>
#include <vector>

#include "client/core/mesh/scene.h"
#include "common/ground/ground.h"
#include "common/lattice/lattice.h"

namespace ridgecast::core {

// Where the ray meets the mesh, to a step.
std::optional<lattice::Vertex> touched(const Scene& scene, const ground::Ray& ray);

struct Spot {
  lattice::Point at;
  double y = 0;  // metres
};
// On the mesh, or at the middle's height where there is none. At most 96 spots around, and 256 between two corners.
struct Outline {
  std::vector<Spot> around;  // a circle
  std::vector<Spot> line;    // from corner to corner, at most 4 m apart, and to the middle; without corners empty
};
// Radius in steps.
Outline outlineOf(const Scene& scene, const lattice::Vertex& middle, lattice::Step radius, const std::vector<lattice::Vertex>& corners);

}  // namespace ridgecast::core
