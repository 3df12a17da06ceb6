// A line that loses one packet in a hundred, by the kernel's own network emulator in a network namespace of this process. Where the kernel
// has none, or does not let this process have a namespace, the test says so and is skipped; lines_test.cpp has long lines everywhere.

#include <gtest/gtest.h>
#include <sched.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "tests/support/quick_turn.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

// Empty, or why there is no such line.
std::string enterLossyNetwork() {
  if (::unshare(CLONE_NEWNET) != 0 && ::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
    return std::string("this process may not have a network namespace of its own: ") + std::strerror(errno);
  if (std::system("ip link set lo up") != 0) return "its network namespace has no loopback: iproute2 is missing, or may not change it";
  // 100 ms there and back, up to 10 ms more each way, 10 Mbit/s, 1 % of the packets lost.
  if (std::system("tc qdisc add dev lo root netem delay 55ms 5ms loss 1% rate 10mbit limit 10000") != 0) return "the kernel has no netem";
  return {};
}

TEST(Loss, AQuickTurnShowsNoHole) {
  if (const std::string why = enterLossyNetwork(); !why.empty()) GTEST_SKIP() << "SKIPPED: " << why;
  ServerProcess server(RIDGECAST_SERVER);
  wire::Settings settings;
  settings.threshold = 1;
  settings.triangleBudget = 100'000;
  Traveller client(server.url(), settings);
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", client.line().world());
  // What TCP sends again comes a round trip later, and what came meanwhile waits for it.
  expectQuickTurn(client, path, 300, 2000);
  EXPECT_TRUE(server.healthy());
}

}  // namespace
}  // namespace ridgecast
