// A flight of a minute in lock-step against the real server: client and server hold the same mesh after every iteration, whatever the
// number of the server's threads.

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

constexpr int kRate = 10, kIterations = 60 * kRate;

struct Flown {
  std::vector<std::uint64_t> hashes;
  std::uint64_t generated = 0, dropped = 0, inserted = 0, removed = 0;
  MeshReport middle, end;
  std::string failure;
};

// Along alpine.json, which begins again after 40 s: a jump of two kilometres, over which leaves are dropped and generated beside
// refined ones. The flier throws at the first iteration after which its hash is not the server's.
Flown flyAMinute(const std::string& threads, bool check) {
  Flown flown;
  try {
    ServerProcess server(RIDGECAST_SERVER, {"--threads", threads});
    wire::Settings settings;
    settings.threshold = 1.5;
    Flier flier(server.url(), settings);
    const PathCamera path(RIDGECAST_PATHS "/alpine.json", flier.world());
    for (int k = 0; k < kIterations; ++k) {
      const wire::Iteration iteration = flier.step(path.looped(static_cast<double>(k) / kRate));
      flown.hashes.push_back(flier.scene().hash());
      flown.generated += iteration.figures.generatedLeaves;
      flown.dropped += iteration.figures.droppedLeaves;
      flown.inserted += iteration.figures.inserted;
      flown.removed += iteration.figures.removed;
      if (check && k == kIterations / 2) flown.middle = flier.check();
    }
    if (check) flown.end = flier.check();
    if (!server.healthy()) flown.failure = "the server is not well at the end: " + server.process().output();
  } catch (const std::exception& e) {
    flown.failure = e.what();
  }
  return flown;
}

TEST(Flight, ServerAndClientHoldTheSameMeshForAMinuteWithOneTwoAndEightThreads) {
  Flown one, two, eight;
  // Two at a time: a client waits half of the time.
  std::thread other([&] { one = flyAMinute("1", false); });
  two = flyAMinute("2", true);
  other.join();
  eight = flyAMinute("8", false);
  for (const auto* flown : {&one, &two, &eight}) {
    ASSERT_EQ(flown->failure, "");
    ASSERT_EQ(flown->hashes.size(), std::size_t{kIterations});
  }
  for (std::size_t k = 0; k < two.hashes.size(); ++k) {
    ASSERT_EQ(one.hashes[k], two.hashes[k]) << "one and two threads, iteration " << k + 1;
    ASSERT_EQ(eight.hashes[k], two.hashes[k]) << "eight and two threads, iteration " << k + 1;
  }
  EXPECT_TRUE(two.middle.clean()) << two.middle.text();
  EXPECT_TRUE(two.end.clean()) << two.end.text();
  // It was a flight worth its name.
  EXPECT_GT(two.generated, 1000u);
  EXPECT_GT(two.dropped, 0u);
  EXPECT_GT(two.inserted, 10'000u);
  EXPECT_GT(two.removed, 1000u);
  EXPECT_GT(two.end.triangles, 10'000u);
  RecordProperty("triangles", static_cast<int>(two.end.triangles));
}

}  // namespace
}  // namespace ridgecast
