#pragma once
// How finely the mesh is drawn and whether it is corrected (render/correction_pass.h), by what a sample of it has cost so far. No clock and
// no OpenGL: times are arguments.

#include <chrono>
#include <cstdint>

#include "client/render/view.h"

namespace ridgecast::viewer {

inline constexpr std::uint32_t kCoarsest = 16;  // pixels a sample, in each direction

// The view with one sample for a square of n x n pixels, at least one.
render::View coarser(const render::View& view, std::uint32_t n);
double samplesOf(const render::View& view);
// The finest power of two that fits the budget at `perSample` milliseconds.
std::uint32_t fitting(const render::View& view, double perSample, std::chrono::milliseconds budget);

class MeshCost {
 public:
  // Of the last picture: how long it took in all and for its correction alone; 0: it was not corrected.
  void drew(const render::View& samples, double milliseconds, double correction);

  std::uint32_t coarseness(const render::View& view, std::chrono::milliseconds budget) const { return fitting(view, perSample_, budget); }
  // Whether a corrected picture of these samples would be in time. After a late one, it must fit kKeepsUp of the budget, so that pictures
  // do not alternate.
  bool correctsInTime(const render::View& samples, std::chrono::milliseconds budget) const;
  static constexpr double kKeepsUp = 0.7;

 private:
  double perSample_ = 0, perCorrection_ = 0;  // milliseconds
  bool corrected_ = false;                    // the last picture
};

}  // namespace ridgecast::viewer
