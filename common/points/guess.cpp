// Sums run counter-clockwise over the known neighbours, from the smallest by x, then z; heights are relative to that one's.
#include "common/points/guess.h"

#include <cmath>

#include "common/lattice/lattice.h"

namespace ridgecast::points {

namespace {

// Of the neighbours' second moments (n in all, for each has 1): the determinant from which on a plane is sure, for n^2.
constexpr double kMinSpread = 1e-3;

}  // namespace

Guess Guesser::fit(triangulation::Point2 at) {
  if (ring_.empty()) return {last_.y, false};
  std::rotate(ring_.begin(),
              std::min_element(ring_.begin(), ring_.end(), [](const auto& a, const auto& b) { return smaller(a.point(), b.point()); }),
              ring_.end());
  const std::int32_t base = ring_.front().y;
  double sum = 0, sx = 0, sz = 0, sy = 0, sxx = 0, sxz = 0, szz = 0, sxy = 0, szy = 0;
  for (const triangulation::Vertex& u : ring_) {
    const double x = u.x - at.x, z = u.z - at.z, y = u.y - base, w = 1 / (x * x + z * z);
    sum += w;
    sx += w * x;
    sz += w * z;
    sy += w * y;
    sxx += w * (x * x);
    sxz += w * (x * z);
    szz += w * (z * z);
    sxy += w * (x * y);
    szy += w * (z * y);
  }
  // The plane's height at the vertex is `level`, its slopes p and q: least sum of w (level + p x + q z - y)^2.
  const double cxx = sxx - sx * sx / sum, czz = szz - sz * sz / sum, cxz = sxz - sx * sz / sum;
  const double cxy = sxy - sx * sy / sum, czy = szy - sz * sy / sum;
  const double spread = cxx * czz - cxz * cxz;
  double level = sy / sum;
  const double n = static_cast<double>(ring_.size());
  const bool isSure = spread > kMinSpread * (n * n);
  if (isSure) {
    const double p = (cxy * czz - czy * cxz) / spread, q = (czy * cxx - cxy * cxz) / spread;
    level = (sy - p * sx - q * sz) / sum;
  }
  constexpr double kMax = lattice::kMaxHeight;
  const double y = std::floor(base + level);
  return {static_cast<std::int32_t>(y > kMax ? kMax : y < -kMax ? -kMax : y), isSure};
}

}  // namespace ridgecast::points
