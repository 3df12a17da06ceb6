#include "server/refinement/colour_error.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"
#include "common/terrain/shades.h"
#include "server/refinement/triangle.h"

namespace ridgecast::refinement {

ColourError::ColourError(std::shared_ptr<const terrain::Terrain> terrain, double bound)
    : terrain_(std::move(terrain)), bound_(bound > 0 && terrain_->colours() ? bound : 0) {}

void ColourError::tints(lattice::Point anchor, std::span<const triangulation::Point2> points, int level, std::span<Tint> out) const {
  expects(points.size() == out.size(), "there is a tint for each point");
  thread_local std::vector<lattice::Step> x, z;
  thread_local std::vector<terrain::Shade> shades;
  x.clear();
  z.clear();
  shades.resize(points.size());
  for (const triangulation::Point2& p : points) {
    x.push_back(anchor.x + p.x);
    z.push_back(anchor.z + p.z);
  }
  terrain::shadesAt(*terrain_, x, z, level, shades);
  for (std::size_t k = 0; k < points.size(); ++k)
    out[k] = {static_cast<float>(shades[k].red) / 255, static_cast<float>(shades[k].green) / 255, static_cast<float>(shades[k].blue) / 255};
}

double ColourError::at(const std::array<Corner, 3>& corners, triangulation::Point2 p, const Tint& tint, double share) const {
  const auto& [a, b, c] = corners;
  const Weights w = weightsAt(a.at, b.at, c.at, p);
  double difference = 0;
  for (std::size_t k = 0; k < tint.size(); ++k) {
    const double shown = a.tint[k] + w.b * (double(b.tint[k]) - a.tint[k]) + w.c * (double(c.tint[k]) - a.tint[k]);
    difference = std::max(difference, std::abs(shown - tint[k]));
  }
  if (difference <= share * bound_) return 0;
  const auto side = [](const triangulation::Vertex& u, const triangulation::Vertex& v) {
    return std::hypot(double(u.x) - v.x, double(u.z) - v.z);
  };
  return kSmear * difference * std::max({side(a.at, b.at), side(b.at, c.at), side(c.at, a.at)});
}

}  // namespace ridgecast::refinement
