#include "client/evaluation/references.h"

#include <algorithm>
#include <utility>

namespace ridgecast::evaluation {

const References::March* References::find(const camera::Camera& camera, std::uint32_t samples, bool unfiltered) const {
  const auto found = std::ranges::find_if(
      marches_, [&](const March& m) { return m.camera == camera && m.samples == samples && (m.unfiltered || !unfiltered); });
  return found == marches_.end() ? nullptr : &*found;
}

const References::March& References::keep(March march) {
  if (marches_.size() >= most_) marches_.pop_front();
  return marches_.emplace_back(std::move(march));
}

}  // namespace ridgecast::evaluation
