#include <algorithm>

#include "server/pipeline/pipeline.h"

namespace ridgecast::pipeline {

namespace {
constexpr double kDefaultPixels = 0.6, kDefaultArea = 1.2, kDefaultThesis = 2e-5;
}  // namespace

wire::Settings grant(const wire::Settings& asked, const Limits& limits) {
  wire::Settings granted = asked;
  if (granted.metric == wire::Metric::kDefault) granted.metric = wire::Metric::kPixels;
  const bool thesis = granted.metric == wire::Metric::kThesis;
  if (!(granted.threshold > 0))
    granted.threshold = thesis ? kDefaultThesis : granted.metric == wire::Metric::kArea ? kDefaultArea : kDefaultPixels;
  granted.threshold = std::clamp(granted.threshold, thesis ? 1e-9 : 0.05, thesis ? 1e9 : 1000.0);
  if (granted.triangleBudget == 0) granted.triangleBudget = limits.defaultBudget;
  granted.triangleBudget = std::clamp<std::uint32_t>(granted.triangleBudget, 10'000, limits.maxBudget);
  granted.candidates = std::min(granted.candidates, wire::kMaxCandidates);
  return granted;
}

}  // namespace ridgecast::pipeline
