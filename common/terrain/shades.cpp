#include "common/terrain/shades.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"

namespace ridgecast::terrain {

Shade makeShade(const std::array<float, 3>& normal, const std::array<float, 3>& colour) {
  const auto direction = [&](float v) {
    const float s = v / (1.0f + std::max(normal[1], 0.0f));
    return static_cast<std::int8_t>(std::lround(std::isfinite(s) ? std::clamp(s, -1.0f, 1.0f) * 127.0f : 0.0f));
  };
  const auto part = [](float v) {
    return static_cast<std::uint8_t>(std::lround(std::isfinite(v) ? std::sqrt(std::clamp(v, 0.0f, 1.0f)) * 255.0f : 0.0f));
  };
  return {direction(normal[0]), direction(normal[2]), part(colour[0]), part(colour[1]), part(colour[2])};
}

void shadesAt(const Terrain& terrain, std::span<const lattice::Step> x, std::span<const lattice::Step> z, int level, std::span<Shade> out) {
  expects(x.size() == out.size() && z.size() == out.size(), "each place has its shade");
  expects(level >= 0 && level <= lattice::kMaxLevel, "a level is a leaf's");
  const lattice::Step reach = lattice::Step{128} << level;
  constexpr std::size_t kBatch = 51;  // points; 255 heights fill one block of the evaluator
  std::array<lattice::Step, kBatch * 5> sampleX, sampleZ;
  std::array<float, kBatch * 5> h;
  std::array<float, kBatch> height;
  std::array<std::array<float, 3>, kBatch> normal, colour;
  for (std::size_t begin = 0; begin < out.size(); begin += kBatch) {
    const std::size_t n = std::min(kBatch, out.size() - begin);
    for (std::size_t k = 0; k < n; ++k) {
      const lattice::Step px = x[begin + k], pz = z[begin + k];
      const std::array<std::array<lattice::Step, 2>, 5> at = {
          {{px, pz}, {px - reach, pz}, {px + reach, pz}, {px, pz - reach}, {px, pz + reach}}};
      for (std::size_t s = 0; s < 5; ++s) sampleX[5 * k + s] = at[s][0], sampleZ[5 * k + s] = at[s][1];
    }
    terrain.heights(std::span(sampleX).first(5 * n), std::span(sampleZ).first(5 * n), std::span(h).first(5 * n));
    for (std::size_t k = 0; k < n; ++k) {
      const float dx = h[5 * k + 1] - h[5 * k + 2], dz = h[5 * k + 3] - h[5 * k + 4];
      const float up = static_cast<float>(2 * static_cast<double>(reach) * lattice::kMetresPerStep);
      const float length = std::sqrt(dx * dx + up * up + dz * dz);
      height[k] = h[5 * k];
      normal[k] = {dx / length, up / length, dz / length};
    }
    const float footprint = static_cast<float>(static_cast<double>(reach) * lattice::kMetresPerStep);
    terrain.colours()(x.data() + begin, z.data() + begin, height.data(), normal.data(), footprint, colour.data(), n, terrain.seed());
    for (std::size_t k = 0; k < n; ++k) out[begin + k] = makeShade(normal[k], colour[k]);
  }
}

}  // namespace ridgecast::terrain
