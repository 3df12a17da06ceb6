#pragma once
// Which ground the ground itself hides from a camera, so that no vertex is spent on it.
//
// Rays leave the eye in fixed directions of the compass; along each the true terrain is sampled at distances that grow geometrically, and
// the steepest elevation up to each is kept. A point is hidden when it lies below what both neighbouring rays have seen before it. That
// depends on the eye's position, not its direction. Between rays and samples the ground may dip, so a few points that are seen through a
// notch a few pixels wide are called hidden; points called visible merely cost triangles.
//
// While the eye moves the rays start from a centre that it may leave a little before they are cast again; at rest they start from the eye.
// Only the directions that the wide frustum can see are cast. follow(): one thread; then any number of threads cast() different rays.
// hidden(): any thread, in between.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::refinement {

class Horizon {
 public:
  // Rays point at equal steps along the square |x| + |z| = 1, a third to two thirds of a degree apart, and samples are equally far apart
  // within each doubling of the distance: a point's ray and sample are then found without an arc tangent or a logarithm.
  static constexpr int kRays = 720;
  static constexpr int kDoubling = 10;  // samples
  static constexpr int kSamples = 10 * kDoubling;
  static constexpr double kFirst = 32;  // metres: the nearest sample; the last is 31 km away

  explicit Horizon(std::shared_ptr<const terrain::Terrain> terrain) : terrain_(std::move(terrain)) {}
  // Sets new ground, which differs only within these areas: rays over them are cast again, or all rays if the eye is not at the centre.
  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed);

  // Where the eye is now; `above`: metres over the ground; `leave`: how far it may leave the centre, 1 as a rule; 0, for an eye at rest:
  // not at all. The rays that are to be cast before the next hidden(), by number.
  const std::vector<int>& follow(const camera::Camera& camera, double above, double leave, double widening);
  // Casts a ray that follow() named.
  void cast(int ray);

  // Whether a point, in metres from the eye, lies more than `margin` (a tangent) below what is in front of it.
  bool hidden(const camera::Vec3& p, double margin) const;

  std::uint64_t heights() const { return heights_; }  // named to be evaluated so far

 private:
  bool isOver(int ray, const lattice::Area& area) const;

  std::shared_ptr<const terrain::Terrain> terrain_;
  camera::Pose centre_;
  bool centred_ = false, isOnOtherGround_ = false;
  camera::Vec3 offset_{};  // metres, from the centre to the eye
  std::vector<std::uint8_t> known_ = std::vector<std::uint8_t>(kRays, 0);
  std::vector<float> steepest_;  // [ray][sample]: largest tangent of the elevation from the first sample up to this one
  std::vector<int> wanted_;
  std::uint64_t heights_ = 0;
};

}  // namespace ridgecast::refinement
