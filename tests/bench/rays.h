#pragma once
// The error on screen, measured by rays: for a grid of pixels the true point that the ray sees is found by marching the terrain, and the mesh's
// height there is compared with it, in pixels where the camera looks straight at it.

#include <memory>
#include <vector>

#include "common/camera/camera.h"
#include "common/terrain/terrain.h"
#include "common/wire/messages.h"

namespace ridgecast::bench {

struct Hit {
  lattice::Point point;
  double y;         // metres, of the terrain
  double pixels;    // that one metre of height covers there
  double distance;  // metres
};

// The ground seen within 20 km, by a grid of rays so many across the picture.
std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, int across);

// Errors in pixels at the hits, of a mesh refined till it settles.
struct Settled {
  std::vector<double> pixels;
  std::vector<double> distance;
  std::uint32_t triangles;
  double heightsPerVertex;
};
Settled settle(const std::shared_ptr<const terrain::Terrain>& terrain, const camera::Camera& camera, const std::vector<Hit>& hits,
               wire::Metric metric, double threshold);

double percentile(std::vector<double> values, double share);  // NaN of none
double mean(const std::vector<double>& values);

}  // namespace ridgecast::bench
