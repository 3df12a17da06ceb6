// A server that is killed comes back on its port: nobody restarts a client, and all hold the right mesh again (MEASURE=1: within five
// seconds).

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/traveller.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using Clock = std::chrono::steady_clock;

wire::Settings coarse() {
  wire::Settings s;
  s.threshold = 3;
  return s;
}

TEST(Resume, EightClientsSurviveAServerThatIsKilled) {
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER);
  const std::uint16_t port = server->port();
  std::vector<std::unique_ptr<Traveller>> clients;
  for (int k = 0; k < 8; ++k) clients.push_back(std::make_unique<Traveller>(server->url(), coarse()));
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", clients[0]->line().world());
  const auto began = Clock::now();
  // Until it is so; false when that does not come.
  const auto fly = [&](auto until) {
    for (const auto end = Clock::now() + kTimeout; !until();) {
      if (Clock::now() > end) return false;
      const double t = std::chrono::duration<double>(Clock::now() - began).count();
      for (std::size_t k = 0; k < clients.size(); ++k) {
        clients[k]->send(path.looped(t + 3 * static_cast<double>(k)));
        EXPECT_TRUE(clients[k]->take(0ms)) << clients[k]->failure();
      }
      std::this_thread::sleep_for(30ms);
    }
    return true;
  };
  const auto for_ = [&](std::chrono::milliseconds time) {
    const auto end = Clock::now() + time;
    fly([&] { return Clock::now() > end; });
  };
  const auto all = [&](auto is) { return std::all_of(clients.begin(), clients.end(), [&](auto& c) { return is(*c); }); };
  const auto allAgree = [&] { return all([](Traveller& c) { return c.agrees() && c.iterations() > 10; }); };
  ASSERT_TRUE(fly(allAgree));

  server->process().signal(SIGKILL);
  server->process().wait(kTimeout);
  EXPECT_TRUE(fly([&] { return all([](Traveller& c) { return c.line().error().has_value(); }); })) << "a client that did not notice";
  for_(1s);
  for (auto& c : clients) EXPECT_GT(c->scene().triangles(), 1000u) << "what is held stays";
  server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);
  const auto back = Clock::now();
  EXPECT_TRUE(fly(allAgree));
  const double seconds = std::chrono::duration<double>(Clock::now() - back).count();
  if (measures()) {
    EXPECT_LT(seconds, 5);
  }
  RecordProperty("milliseconds", static_cast<int>(seconds * 1e3));
  for_(1s);
  for (auto& c : clients) {
    EXPECT_EQ(c->line().reconnections(), 1u);
    EXPECT_EQ(c->mismatches(), 0u);
    EXPECT_GT(c->resumed(), 100u);
  }
  EXPECT_TRUE(server->healthy());
}

}  // namespace
}  // namespace ridgecast
