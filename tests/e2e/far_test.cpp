// A flight that goes away and comes back, again and again. (Far out: fly_test.cpp and integration/stream_test.cpp.)

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

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
