#pragma once
// What a client requests of its mesh and is granted (metric, threshold, budgets), and what an iteration then did. Numbers are the
// protocol's (PROTOCOL.md, Settings).

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace ridgecast::settings {

// How the need for a vertex is measured; server/refinement/metric.h has the formulas.
enum class Metric { kDefault = 0, kPixels = 1, kThesis = 2, kArea = 3 };

struct MetricTraits {
  std::string_view name;          // in flags, files and logs
  double threshold, least, most;  // by default; granted
};
inline constexpr std::array<MetricTraits, 4> kMetrics{{
    {"default", 0.6, 0.05, 1000},  // kPixels
    {"pixels", 0.6, 0.05, 1000},
    {"thesis", 2e-5, 1e-9, 1e9},
    {"area", 1.2, 0.05, 1000},
}};

constexpr const MetricTraits& traits(Metric metric) { return kMetrics[static_cast<std::size_t>(metric)]; }
constexpr std::optional<Metric> metricNamed(std::string_view name) {
  const auto found = std::find_if(kMetrics.begin(), kMetrics.end(), [&](const MetricTraits& m) { return m.name == name; });
  return found == kMetrics.end() ? std::nullopt : std::optional(static_cast<Metric>(found - kMetrics.begin()));
}

inline constexpr std::uint32_t kDefaultBudget = 500'000, kMinBudget = 10'000, kMaxBudget = 2'000'000;  // triangles

inline constexpr double kMinColourError = 0.01, kMaxColourError = 1;

inline constexpr std::uint32_t kMaxCandidates = 20'000;  // of an iteration

struct Settings {
  Metric metric = Metric::kDefault;
  double threshold = 0;              // 0: the default of the metric
  std::uint32_t triangleBudget = 0;  // 0: the server's default
  std::uint64_t bytesPerSecond = 0;  // 0: unlimited
  std::uint32_t candidates = 0;      // at most this many of an iteration
  double colourError = 0;            // share of full red, green or blue that vertex colours may be off; 0: refinement ignores colour
  friend bool operator==(const Settings&, const Settings&) = default;
};

// What an iteration did. Milliseconds are wall time.
struct IterationStats {
  double selectMs = 0, generateMs = 0, refineMs = 0, triangulateMs = 0, encodeMs = 0;
  std::uint32_t leaves = 0, visibleLeaves = 0, generatedLeaves = 0, droppedLeaves = 0;
  std::uint32_t triangles = 0, inserted = 0, removed = 0, deferred = 0;
  std::uint64_t heights = 0;
  double effectiveThreshold = 0;
  std::uint32_t insertionLimit = 0;
};

}  // namespace ridgecast::settings
