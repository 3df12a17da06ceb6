#pragma once
// Which two meshes are blended, and in which ratio: a change of the mesh is shown over kMorphSeconds. Further changes wait until that is
// done, so the picture is at most two such intervals behind. Holds at most two generations of leaves beside the scene's; they share
// unchanged geometry.

#include <algorithm>
#include <cstdint>
#include <optional>

#include "client/core/mesh/scene.h"
#include "common/outcome/contract.h"

namespace ridgecast::render {

inline constexpr double kMorphSeconds = 0.3;

class Morph {
 public:
  using Leaves = core::Leaves;

  // Call once a frame. `now` in seconds ascends; `version` tells states of the leaves apart. Without `smooth`, and for the first mesh, a
  // change shows at once.
  void advance(const Leaves& leaves, std::uint64_t version, double now, bool smooth) {
    expects(!began_ || now >= *began_, "time does not go back");
    if (began_ && now - *began_ >= kMorphSeconds) {
      began_.reset();
      from_ = to_;
    }
    const bool atOnce = !smooth || to_.empty();
    if (version == version_ || (began_ && !atOnce)) return;
    from_ = atOnce ? leaves : to_;
    to_ = leaves;
    version_ = version;
    began_ = atOnce ? std::nullopt : std::optional(now);
  }
  bool active() const { return began_.has_value(); }
  // The share of to(), 0..1.
  float share(double now) const { return began_ ? static_cast<float>(std::clamp((now - *began_) / kMorphSeconds, 0.0, 1.0)) : 1.0f; }
  const Leaves& from() const { return from_; }
  const Leaves& to() const { return to_; }
  std::uint64_t version() const { return version_; }  // of to()

 private:
  Leaves from_, to_;
  std::uint64_t version_ = ~std::uint64_t{0};
  std::optional<double> began_;
};

}  // namespace ridgecast::render
