#include "server/scheduling/usage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace ridgecast::scheduling {
namespace {

using namespace std::chrono_literals;

const Usage::Time kStart = Usage::Time{} + 1000s;

TEST(Usage, ComesToWhatIsAtWorkAndForgetsIt) {
  Usage usage;
  EXPECT_EQ(usage.mean(kStart), 0);
  usage.set(2, kStart);
  EXPECT_NEAR(usage.mean(kStart), 0, 1e-9);
  EXPECT_NEAR(usage.mean(kStart + Usage::kMemory), 2 * (1 - std::exp(-1)), 1e-9);
  EXPECT_NEAR(usage.mean(kStart + 60s), 2, 1e-4);
  usage.set(0, kStart + 60s);
  EXPECT_NEAR(usage.mean(kStart + 60s + Usage::kMemory), 2 * std::exp(-1), 1e-4);
  EXPECT_NEAR(usage.mean(kStart + 180s), 0, 1e-6);
}

// The integral of what was at work, weighted by e^(-age / kMemory), summed in steps of a millisecond.
TEST(Usage, IsTheWeightedMeanOfWhatWasAtWork) {
  constexpr double kMemory = std::chrono::duration<double>(Usage::kMemory).count(), kStep = 0.001;
  std::mt19937 random(3);
  for (int round = 0; round < 20; ++round) {
    Usage usage;
    std::vector<unsigned> working;  // in each millisecond
    while (working.size() < 12'000) {
      const unsigned now = random() % 5;
      usage.set(now, kStart + std::chrono::milliseconds(working.size()));
      working.insert(working.end(), 1 + random() % 700, now);
    }
    double sum = 0;
    for (std::size_t k = 0; k < working.size(); ++k)
      sum += working[k] * kStep / kMemory * std::exp(-(static_cast<double>(working.size() - k) - 0.5) * kStep / kMemory);
    EXPECT_NEAR(usage.mean(kStart + std::chrono::milliseconds(working.size())), sum, 1e-3);
  }
}

}  // namespace
}  // namespace ridgecast::scheduling
