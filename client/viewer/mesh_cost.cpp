#include "client/viewer/mesh_cost.h"

#include <algorithm>

#include "common/outcome/contract.h"

namespace ridgecast::viewer {

render::View coarser(const render::View& view, std::uint32_t n) {
  expects(n >= 1, "a sample stands for a pixel or more");
  render::View out = view;
  out.camera.projection.width = std::max(1u, view.camera.projection.width / n);
  out.camera.projection.height = std::max(1u, view.camera.projection.height / n);
  return out;
}

double samplesOf(const render::View& view) { return static_cast<double>(view.camera.projection.width) * view.camera.projection.height; }

std::uint32_t fitting(const render::View& view, double perSample, std::chrono::milliseconds budget) {
  std::uint32_t n = 1;
  while (n < kCoarsest && samplesOf(coarser(view, n)) * perSample > static_cast<double>(budget.count())) n *= 2;
  return n;
}

void MeshCost::drew(const render::View& samples, double milliseconds, double correction) {
  expects(correction >= 0 && samplesOf(samples) > 0, "a drawing has samples, and its correction takes time");
  perSample_ = (milliseconds - correction) / samplesOf(samples);
  corrected_ = correction > 0;
  if (corrected_) perCorrection_ = correction / samplesOf(samples);
}

bool MeshCost::correctsInTime(const render::View& samples, std::chrono::milliseconds budget) const {
  const double milliseconds = samplesOf(samples) * (perSample_ + perCorrection_);
  return milliseconds <= (corrected_ ? 1 : kKeepsUp) * static_cast<double>(budget.count());
}

}  // namespace ridgecast::viewer
