#pragma once
// Colours of leaves by level and by time since their last change, and of candidates by error. The ramps grow in brightness alone, so that
// everybody can tell them apart.

#include <array>
#include <cstdint>
#include <unordered_map>

#include "client/core/mesh/scene.h"

namespace ridgecast::viewer {

using Colour = std::array<float, 3>;  // display values

Colour levelColour(int level);      // viridis: the finest is yellow, the coarsest dark violet
Colour ageColour(double seconds);   // inferno: now is pale yellow, kOld and more is black; even steps for each doubling
inline constexpr double kOld = 60;  // seconds
// inferno: pale yellow from kErrorRange times the threshold, orange at the threshold, violet below; even steps for each doubling.
Colour errorColour(double pixels, double threshold);
inline constexpr double kErrorRange = 8;

// When each leaf last changed, as seen by this client.
class LeafAges {
 public:
  // Call after every iteration; `now` in seconds ascends. Leaves of the first call count as oldest.
  void update(const core::Leaves& leaves, double now);
  double age(const lattice::LeafAddress& address, double now) const;  // kOld if unknown
  // Whether some leaf's colour still changes.
  bool moving(double now) const { return now - newest_ < kOld; }

 private:
  struct Seen {
    std::uint64_t version = 0;
    double when = 0;
  };
  std::unordered_map<lattice::LeafAddress, Seen, lattice::LeafAddressHash> seen_;
  bool first_ = true;
  double newest_ = -kOld;
};

}  // namespace ridgecast::viewer
