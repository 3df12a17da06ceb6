// Flights where floating point would give up, and one that goes away and comes back: the mesh that the client holds is sound there.

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

constexpr double kRate = 5;

class Paths : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(All, Paths, testing::Values("alpine-1e8", "alpine-1e12", "alpine-return"), [](const auto& p) {
  std::string name = p.param;
  std::erase(name, '-');
  return name;
});

TEST_P(Paths, TheMeshIsSoundInTheMiddleAtTheEndAndAtRest) {
  ServerProcess server(RIDGECAST_SERVER);
  wire::Settings settings;
  settings.threshold = 3;
  Flier flier(server.url(), settings);
  const PathCamera path(RIDGECAST_PATHS "/" + GetParam() + ".json", flier.world());
  const int steps = static_cast<int>(path.duration() * kRate);
  std::uint64_t dropped = 0;
  for (int k = 0; k <= steps; ++k) {
    dropped += flier.step(path.at(k / kRate)).figures.droppedLeaves;
    // Of the flight away and back, also where it is farthest.
    if (k % (steps / 4) == 0 && k > 0) {
      const MeshReport report = flier.check();
      ASSERT_TRUE(report.clean()) << "iteration " << k + 1 << ": " << report.text();
    }
  }
  flier.settle(path.at(path.duration()));
  const MeshReport report = flier.check();
  EXPECT_TRUE(report.clean()) << report.text();
  EXPECT_GT(report.triangles, 10'000u);
  EXPECT_GT(dropped, 0u);
  EXPECT_TRUE(server.healthy());
}

// Vertices out of sight stay while there is room, so a mesh remembers where its camera was; but it does not grow with every round.
TEST(Return, RoundAfterRoundTheMeshHasTheSameSize) {
  ServerProcess server(RIDGECAST_SERVER);
  wire::Settings settings;
  settings.threshold = 3;
  Flier flier(server.url(), settings);
  const PathCamera path(RIDGECAST_PATHS "/alpine-return.json", flier.world());
  std::vector<double> triangles;
  for (int round = 0; round < 4; ++round) {
    for (int k = 0; k <= path.duration(); ++k) flier.step(path.at(k));
    flier.settle(path.at(path.duration()));
    triangles.push_back(static_cast<double>(flier.scene().triangles()));
  }
  EXPECT_NEAR(triangles[3] / triangles[1], 1, 0.05) << testing::PrintToString(triangles);
  const MeshReport report = flier.check();
  EXPECT_TRUE(report.clean()) << report.text();
}

}  // namespace
}  // namespace ridgecast
