#pragma once
// Colours of leaves, by level and by how long ago they changed, and of candidates by their error: ramps that grow in brightness alone, and so can be told apart by everybody.

#include <array>
#include <cstdint>
#include <unordered_map>

#include "client/scene/scene.h"

namespace ridgecast::viewer {

using Colour = std::array<float, 3>;  // display values

Colour levelColour(int level);      // viridis: the finest is yellow, the coarsest dark violet
Colour ageColour(double seconds);   // inferno: just now is pale yellow, kOld and more is black; even steps for each doubling
inline constexpr double kOld = 60;  // seconds
// inferno: at kErrorRange times the threshold and more it is pale yellow, at the threshold orange, violet below; even steps for each doubling.
Colour errorColour(double pixels, double threshold);
inline constexpr double kErrorRange = 8;

// When each leaf changed last, as far as this client has seen.
class LeafAges {
 public:
  // After every iteration; `now` in seconds ascends. What is there at the first call is as old as can be.
  void update(const std::map<lattice::LeafAddress, scene::HeldLeaf>& leaves, double now);
  double age(const lattice::LeafAddress& address, double now) const;  // kOld when it is not known
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
