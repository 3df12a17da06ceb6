#include "client/viewer/leaf_colours.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "common/outcome/contract.h"

namespace ridgecast::viewer {
namespace {

// Both by Nathaniel Smith and Stefan van der Walt, 2015, at six places each.
constexpr std::array<Colour, 6> kViridis = {{{0.993f, 0.906f, 0.144f},
                                             {0.478f, 0.821f, 0.318f},
                                             {0.133f, 0.659f, 0.518f},
                                             {0.164f, 0.471f, 0.558f},
                                             {0.254f, 0.265f, 0.530f},
                                             {0.267f, 0.005f, 0.329f}}};
constexpr std::array<Colour, 6> kInferno = {{{0.988f, 0.998f, 0.645f},
                                             {0.981f, 0.644f, 0.040f},
                                             {0.865f, 0.316f, 0.226f},
                                             {0.578f, 0.148f, 0.404f},
                                             {0.258f, 0.039f, 0.406f},
                                             {0.001f, 0.0f, 0.014f}}};

Colour along(std::span<const Colour> ramp, double share) {
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(ramp.size() - 1);
  const auto k = std::min(static_cast<std::size_t>(at), ramp.size() - 2);
  const auto t = static_cast<float>(at - static_cast<double>(k));
  Colour out;
  for (std::size_t c = 0; c < 3; ++c) out[c] = ramp[k][c] + t * (ramp[k + 1][c] - ramp[k][c]);
  return out;
}

}  // namespace

Colour levelColour(int level) {
  expects(level >= 0 && level <= lattice::kMaxLevel, "a leaf's level is one of the lattice's");
  return along(kViridis, static_cast<double>(level) / lattice::kMaxLevel);
}

Colour ageColour(double seconds) { return along(kInferno, std::log2(1 + std::max(seconds, 0.0)) / std::log2(1 + kOld)); }

Colour errorColour(double pixels, double threshold) {
  const double doublings = std::log2(std::max(pixels, 1e-9) / std::max(threshold, 1e-9)), range = std::log2(kErrorRange);
  return along(kInferno, 0.32 - 0.32 * doublings / range);
}

void LeafAges::update(const core::Leaves& leaves, double now) {
  std::erase_if(seen_, [&](const auto& entry) { return !leaves.contains(entry.first); });
  for (const auto& [address, leaf] : leaves) {
    Seen& seen = seen_[address];
    if (seen.version == leaf.version) continue;
    seen = {leaf.version, first_ ? now - kOld : now};
    if (!first_) newest_ = now;
  }
  first_ = first_ && leaves.empty();
}

double LeafAges::age(const lattice::LeafAddress& address, double now) const {
  const auto seen = seen_.find(address);
  return seen == seen_.end() ? kOld : std::clamp(now - seen->second.when, 0.0, kOld);
}

}  // namespace ridgecast::viewer
