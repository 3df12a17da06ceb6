#pragma once
// What a client must hold on a long line: a flight along alpine.json with a turn by half a circle in 0.3 s.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "tests/support/traveller.h"
#include "tests/support/waiting.h"

namespace ridgecast::testing_support {

inline constexpr std::size_t kMinAnswers = 20;

inline double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 1e9;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

// Points all round, out to near the horizon, over which nothing is held.
inline int holes(const core::Scene& scene, const camera::Pose& pose) {
  int count = 0;
  for (const double radius : {5.0, 60.0, 700.0, 6'000.0, 29'000.0})
    for (int k = 0; k < 16; ++k) {
      const double angle = (k + 0.37) * std::numbers::pi / 8;
      count +=
          !scene.height({pose.x + std::llround(radius * 256 * std::cos(angle)), pose.z + std::llround(radius * 256 * std::sin(angle))});
    }
  return count;
}

// Eleven seconds where times are measured, otherwise half of that, and as many more as a slow machine takes for a flight worth its name;
// the latencies that the client counts afterwards are those from the fourth second on. Empty, or what went wrong.
inline std::string quickTurn(Traveller& client, const PathCamera& path) {
  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };
  const auto began = Clock::now();
  std::string wrong;
  const auto fly = [&](double seconds, double turn) {
    const auto start = Clock::now();
    if (!measures()) seconds /= 2;
    while (wrong.empty() && since(start) < seconds) {
      camera::Camera camera = path.at(since(began));
      camera.pose.yaw += turn * std::min(1.0, since(start) / 0.3);
      client.send(camera);
      if (!client.take(std::chrono::milliseconds(20))) wrong = client.failure();
      if (client.scene().iteration() == 0) continue;
      if (const int n = holes(client.scene(), camera.pose); n > 0)
        wrong = std::to_string(n) + " holes, " + std::to_string(since(began)) + " s after the start";
    }
  };
  fly(4, 0);
  client.forgetLatencies();
  fly(3, 0);
  fly(2, std::numbers::pi);
  fly(2, 0);
  for (const auto end = Clock::now() + kTimeout; wrong.empty() && client.latencies().size() <= kMinAnswers && Clock::now() < end;)
    fly(1, 0);
  return wrong;
}

// The turn, and what it must leave behind on a line of 100 ms there and back; the test's properties say how long poses waited, and
// MEASURE=1 limits that.
inline void expectQuickTurn(Traveller& client, const PathCamera& path, double mostP50, double mostP99) {
  EXPECT_EQ(quickTurn(client, path), "");
  EXPECT_EQ(client.mismatches(), 0u);
  const double p50 = percentile(client.latencies(), 0.5), p99 = percentile(client.latencies(), 0.99);
  testing::Test::RecordProperty("p50_ms", static_cast<int>(p50));
  testing::Test::RecordProperty("p99_ms", static_cast<int>(p99));
  EXPECT_GT(client.latencies().size(), kMinAnswers);
  EXPECT_GE(p50, 100) << "the line is not as long as it should be";
  if (!measures()) return;
  EXPECT_LT(p50, mostP50);
  EXPECT_LT(p99, mostP99);
}

}  // namespace ridgecast::testing_support
