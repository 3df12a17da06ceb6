#include "common/ground/ground.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/ground/march.h"
#include "common/ground/trace.h"
#include "common/outcome/contract.h"

namespace ridgecast::ground {

using lattice::Step;

double cast(const terrain::Terrain& terrain, const Ray& ray, std::uint64_t* heights) {
  double distance = kNoHit;
  cast(terrain, {&ray, 1}, {&distance, 1}, heights);
  return distance;
}

void cast(const terrain::Terrain& terrain, std::span<const Ray> rays, std::span<double> out, std::uint64_t* heights) {
  expects(out.size() == rays.size(), "each ray has its distance");
  const bool isKnown = terrain.relief().known != terrain::Relief::Known::kSampled;
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
