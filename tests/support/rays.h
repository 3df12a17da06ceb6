#pragma once
// The error on screen, measured by rays: for a grid of pixels the true point that the ray sees is found by marching the terrain, and the
// mesh's height there is compared with it, in pixels where the camera looks straight at it.

#include <limits>
#include <string>
#include <vector>

#include "common/camera/camera.h"
#include "common/terrain/terrain.h"
#include "server/pipeline/pipeline.h"

namespace ridgecast::testing_support {

struct Hit {
  lattice::Point point;
  double y;         // metres, of the terrain
  double pixels;    // that one metre of height covers there
  double distance;  // metres
  camera::Vec3 direction;
  std::size_t ray;  // its place among those cast
};

// The ground seen within 20 km, by a grid of rays so many across the picture.
std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, int across);
// The same along given directions, with steps `finer` times shorter.
std::vector<Hit> castRays(const terrain::Terrain& terrain, const camera::Camera& camera, const std::vector<camera::Vec3>& directions,
                          double finer);

// The mesh as a client holds it, so that no code of the engine answers.
class HeldMesh {
 public:
  explicit HeldMesh(const pipeline::Pipeline& pipeline);
  struct Height {
    double y = std::numeric_limits<double>::quiet_NaN();  // metres; NaN: no triangle of any leaf is there
    int level = 0;                                        // of the leaf that owns the triangle
  };
  std::vector<Height> at(const std::vector<Hit>& hits) const;

 private:
  std::vector<mesh::LeafMesh> leaves_;
};

// The error on screen of the mesh held, for a camera.
struct ScreenError {
  std::size_t rays = 0;      // that meet ground of which there is a mesh
  double p99 = 0, most = 0;  // pixels
  // Rays to a jump of the ground narrower than the lattice's spacing there: the mesh's height is taken on within it. They count for what
  // is left.
  std::size_t jumps = 0;
  double mostAtJump = 0;  // pixels, of the whole error there
  std::string worst;      // what the worst ray sees, where it is above 1.2 thresholds
};
ScreenError errorOnScreen(const pipeline::Pipeline& pipeline, const terrain::Terrain& terrain, const camera::Camera& camera,
                          double threshold, int across);

}  // namespace ridgecast::testing_support
