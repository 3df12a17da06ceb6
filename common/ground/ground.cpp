#include "common/ground/ground.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/ground/march.h"
#include "common/ground/trace.h"
#include "common/outcome/contract.h"

namespace ridgecast::ground {

using lattice::Step;

void normals(const terrain::Terrain& terrain, std::span<const Step> x, std::span<const Step> z, std::uint32_t spacing,
             std::span<float> out) {
  expects(z.size() == x.size() && out.size() == 3 * x.size(), "each place has its normal");
  constexpr std::size_t kBatch = 64;  // 256 heights a call
  const Step s = spacing == 0 ? kDefaultSpacing : spacing;
  std::array<Step, 4 * kBatch> sampleX, sampleZ;
  std::array<float, 4 * kBatch> height;
  const auto within = [](Step v) { return std::clamp(v, -lattice::kMaxPosition, lattice::kMaxPosition); };
  for (std::size_t begin = 0; begin < x.size(); begin += kBatch) {
    const std::size_t n = std::min(kBatch, x.size() - begin);
    for (std::size_t k = 0; k < n; ++k) {
      const Step atX = x[begin + k], atZ = z[begin + k];
      sampleX[k] = within(atX - s), sampleZ[k] = atZ;
      sampleX[n + k] = within(atX + s), sampleZ[n + k] = atZ;
      sampleX[2 * n + k] = atX, sampleZ[2 * n + k] = within(atZ - s);
      sampleX[3 * n + k] = atX, sampleZ[3 * n + k] = within(atZ + s);
    }
    terrain.heights(std::span(sampleX).first(4 * n), std::span(sampleZ).first(4 * n), std::span(height).first(4 * n));
    for (std::size_t k = 0; k < n; ++k) {
      const double acrossX = static_cast<double>(sampleX[n + k] - sampleX[k]) * lattice::kMetresPerStep;
      const double acrossZ = static_cast<double>(sampleZ[3 * n + k] - sampleZ[2 * n + k]) * lattice::kMetresPerStep;
      const double slopeX = (static_cast<double>(height[n + k]) - height[k]) / acrossX;
      const double slopeZ = (static_cast<double>(height[3 * n + k]) - height[2 * n + k]) / acrossZ;
      const double length = std::sqrt(slopeX * slopeX + 1.0 + slopeZ * slopeZ);
      float* normal = &out[3 * (begin + k)];
      normal[0] = static_cast<float>(-slopeX / length);
      normal[1] = static_cast<float>(1.0 / length);
      normal[2] = static_cast<float>(-slopeZ / length);
    }
  }
}

double cast(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights) {
  double distance = kNoHit;
  cast(terrain, {&ray, 1}, {&distance, 1}, heights);
  return distance;
}

void cast(const terrain::Terrain& terrain, std::span<const Ray> rays, std::span<double> out, std::uint64_t* heights) {
  expects(out.size() == rays.size(), "each ray has its distance");
  const bool isKnown = terrain.relief().kind != terrain::Relief::Kind::kUnknown;
  for (std::size_t k = 0; k < rays.size(); k += isKnown ? kPacket : 1) {
    if (!isKnown) {
      out[k] = march(terrain, rays[k], heights);
      continue;
    }
    const std::size_t n = std::min(kPacket, rays.size() - k);
    const std::uint64_t taken = trace(terrain, rays.subspan(k, n), out.subspan(k, n));
    if (heights) *heights += taken;
  }
}

}  // namespace ridgecast::ground
