#pragma once
// Ray marches that several flights over one terrain are compared with: in lock-step all of them see from the same places, and what a
// ray march shows does not depend on the mesh.

#include <cstdint>
#include <deque>
#include <filesystem>
#include <optional>

#include "client/render/renderer.h"

namespace ridgecast::evaluation {

class References {
 public:
  struct March {
    camera::Camera camera;
    std::uint32_t samples = 1;  // a side of each pixel
    render::Picture filtered;
    std::optional<render::Picture> unfiltered;
    double milliseconds = 0, cpuMilliseconds = 0;  // that drawing it took, filtered
    std::filesystem::path file;                    // that holds `filtered`
  };

  // Keeps `most` of them, 1 and up; the oldest go first. One of 1280 x 720 pixels has 7 MB.
  explicit References(std::size_t most) : most_(most) {}

  // What was marched for this camera, unfiltered as well where that is asked for; null: nothing yet. Valid until the next `keep`.
  const March* find(const camera::Camera& camera, std::uint32_t samples, bool unfiltered) const;
  const March& keep(March march);
  // For another terrain.
  void clear() { marches_.clear(); }

 private:
  std::size_t most_;
  std::deque<March> marches_;
};

}  // namespace ridgecast::evaluation
