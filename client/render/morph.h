#pragma once
// Which two meshes are blended, and by how much: a change of the mesh is shown over kMorphSeconds, and what changes meanwhile is taken
// up when that has been shown. What is shown is so at most two of these behind what is held.
// Holds at most two generations of leaves beside the scene's; geometry that they share is shared.

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>

#include "client/scene/scene.h"

namespace ridgecast::render {

inline constexpr double kMorphSeconds = 0.3;

class Morph {
 public:
  using Leaves = std::map<lattice::LeafAddress, scene::HeldLeaf>;

  // Once a frame. `now` in seconds ascends; `version` tells states of the leaves apart; without `smooth` a change shows at once.
  // The first mesh shows at once as well.
  void advance(const Leaves& leaves, std::uint64_t version, double now, bool smooth) {
    if (began_ && now - *began_ >= kMorphSeconds) settle();
    if (version == version_) return;
    if (!smooth || to_.empty()) {
      began_.reset();
      take(leaves, version);
      from_ = to_;
    } else if (!began_) {
      from_ = to_;
      take(leaves, version);
      began_ = now;
    }
  }
  bool active() const { return began_.has_value(); }
  // Of to(), 0..1.
  float share(double now) const { return began_ ? static_cast<float>(std::clamp((now - *began_) / kMorphSeconds, 0.0, 1.0)) : 1.0f; }
  const Leaves& from() const { return from_; }
  const Leaves& to() const { return to_; }
  std::uint64_t version() const { return version_; }  // of to()

 private:
  void settle() {
    began_.reset();
    from_ = to_;
  }
  void take(const Leaves& leaves, std::uint64_t version) {
    to_ = leaves;
    version_ = version;
  }
  Leaves from_, to_;
  std::uint64_t version_ = ~std::uint64_t{0};
  std::optional<double> began_;
};

}  // namespace ridgecast::render
