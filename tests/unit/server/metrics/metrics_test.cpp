#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "server/metrics/metrics.h"

namespace ridgecast::metrics {
namespace {

using testing::HasSubstr;
using testing::UnorderedElementsAreArray;

std::vector<std::string> lines(const std::string& text) {
  std::vector<std::string> found;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) found.push_back(line);
  return found;
}

TEST(Registry, WritesTheExpositionFormat) {
  Registry registry;
  Counter& a = registry.counter("a_total", "Of a.", {{"kind", "x"}});
  registry.counter("a_total", "Of a.", {{"kind", "quo\"te\\\n"}}).Increment(2);
  Gauge& g = registry.gauge("g", "Now.");
  Histogram& h = registry.histogram("h_seconds", "Spread.", {0.1, 1}, {{"stage", "s"}});
  registry.compute("asked", "On demand.", [] { return 1.5; }, {{"kind", "x"}});
  registry.compute("asked", "On demand.", [] { return 2.5; }, {{"kind", "y"}});
  a.Increment();
  g.Increment(5);
  g.Increment(-7);
  for (const double v : {0.05, 0.1, 0.5, 7.0}) h.Observe(v);
  EXPECT_THAT(lines(registry.text()),
              UnorderedElementsAreArray(
                  lines("# HELP a_total Of a.\n# TYPE a_total counter\na_total{kind=\"x\"} 1\na_total{kind=\"quo\\\"te\\\\\\n\"} 2\n"
                        "# HELP g Now.\n# TYPE g gauge\ng -2\n"
                        "# HELP h_seconds Spread.\n# TYPE h_seconds histogram\n"
                        "h_seconds_bucket{stage=\"s\",le=\"0.1\"} 2\nh_seconds_bucket{stage=\"s\",le=\"1\"} "
                        "3\nh_seconds_bucket{stage=\"s\",le=\"+Inf\"} 4\n"
                        "h_seconds_sum{stage=\"s\"} 7.65\nh_seconds_count{stage=\"s\"} 4\n"
                        "# HELP asked On demand.\n# TYPE asked gauge\nasked{kind=\"x\"} 1.5\nasked{kind=\"y\"} 2.5\n")));
}

TEST(Registry, LosesNothingAmongThreads) {
  Registry registry;
  Counter& c = registry.counter("c_total", "C.");
  Histogram& h = registry.histogram("h", "H.", {1});
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t)
    threads.emplace_back([&] {
      for (int k = 0; k < 10'000; ++k) {
        c.Increment();
        h.Observe(k % 2 * 2.0);
        if (k % 1000 == 0) registry.text();
      }
    });
  for (auto& thread : threads) thread.join();
  EXPECT_THAT(registry.text(), HasSubstr("c_total 40000\n"));
  EXPECT_THAT(registry.text(), HasSubstr("h_count 40000\nh_sum 40000\n"));
}

TEST(Metrics, HaveTheirNames) {
  Metrics figures;
  settings::IterationStats iteration;
  iteration.refineMs = 20;
  iteration.inserted = 7;
  figures.iterated(iteration);
  figures.refused(Refusal::kInternal);
  figures.refused(Refusal::kConnections);
  const std::string text = figures.registry.text();
  EXPECT_THAT(text, HasSubstr("ridgecast_iterations_total 1\n"));
  EXPECT_THAT(text, HasSubstr("ridgecast_vertices_inserted_total 7\n"));
  EXPECT_THAT(text, HasSubstr("ridgecast_stage_seconds_sum{stage=\"refine\"} 0.02\n"));
  EXPECT_THAT(text, HasSubstr("ridgecast_refusals_total{reason=\"internal\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("ridgecast_refusals_total{reason=\"connections\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("ridgecast_refusals_total{reason=\"token\"} 0\n"));
  EXPECT_THAT(text, testing::ContainsRegex("process_resident_memory_bytes [1-9]"));
}

}  // namespace
}  // namespace ridgecast::metrics
