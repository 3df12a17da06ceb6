#pragma once
// The difference of two canvases as a heat map in the window: the distance of their display values from 0 (black) through violet and orange
// to light yellow (a quarter of the full range and more), distinguishable for colour-blind eyes. Needs the context it was made in.

#include <array>

#include "client/render/gl_objects.h"
#include "client/render/surface.h"

namespace ridgecast::render {

// Inferno (van der Walt and Smith), at five places: a difference of 0, 1/16, 1/8, 3/16 and 1/4 of the full range.
inline constexpr std::array<std::array<float, 3>, 5> kDifferenceRamp = {
    {{0.0f, 0.0f, 0.016f}, {0.341f, 0.062f, 0.429f}, {0.735f, 0.216f, 0.330f}, {0.976f, 0.557f, 0.035f}, {0.988f, 0.998f, 0.645f}}};

class DifferencePass {
 public:
  static Outcome<DifferencePass> create();
  // Into framebuffer 0, whole, `width` x `height` pixels; stretches canvases of any size over it.
  void present(const Canvas& a, const Canvas& b, int width, int height) const;

 private:
  explicit DifferencePass(Program program) : program_(std::move(program)) {}
  Program program_;
};

}  // namespace ridgecast::render
