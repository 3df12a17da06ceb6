// Several servers' sessions, whatever is asked and fails.
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

#include "tests/support/sanitized.h"
#include "tests/unit/server/http/shared_sessions.h"

namespace ridgecast::http {
namespace {

// Requests at random, servers that come, crash and lose touch for less than a record lives: a name is never two worlds, not for a moment.
TEST(SharedSessionsAtRandom, AreNeverSplit) {
  struct World : SharedSessions {
    explicit World(std::uint64_t seed) : SharedSessions(seed), random(seed) {}
    void TestBody() override {}
    int any(int below) { return static_cast<int>(random() % below); }
    void run() {
      session::Limits limits;
      limits.sessionIdle = 15s;
      for (int k = 0; k < 3; ++k) start(limits);
      std::map<int, SimulatedTimer::Time> cutSince;
      int joined = 0;
      for (int step = 0; step < 300; ++step) {
        const int server = any(static_cast<int>(servers.size()));
        const std::string name = "n" + std::to_string(any(6));
        const int what = any(20);
        if (what < 10) {
          joined += stream(server, name + (any(2) ? "&terrain=flat&seed=" + std::to_string(any(3)) : "")) == 101;
        } else if (what < 13) {
          leave(server, name);
        } else if (what == 13 && cutSince.empty()) {  // a server that is away cannot know
          servers[server]->directory->remove(name);
          leave(server, name);
          pass(2500ms);  // of those that can hear it
        } else if (what == 14) {
          engine.slow(std::chrono::milliseconds(any(40)), std::chrono::milliseconds(1 + any(20)));
        } else if (what == 15 && !cutSince.contains(server)) {
          engine.cut(busOf(server));
          cutSince[server] = timer.now();
        } else if (what == 16 && servers.size() < 5) {
          start(limits);
        } else if (what == 17 && servers.size() > 2) {
          if (server + 1 == static_cast<int>(servers.size()) && !cutSince.contains(server)) servers.pop_back();
        } else {
          pass(std::chrono::milliseconds(any(2500)));
        }
        for (auto it = cutSince.begin(); it != cutSince.end();) {
          if (timer.now() - it->second < 5s) {
            ++it;
            continue;
          }
          engine.mend(busOf(it->first));
          it = cutSince.erase(it);
          pass(3s);
        }
        ASSERT_EQ(splits(), 0) << "step " << step;
      }
      EXPECT_GT(joined, 50);
    }
    std::mt19937_64 random;
  };
  for (int seed = 1; seed <= testing_support::rounds(30); ++seed) {
    SCOPED_TRACE(seed);
    World(static_cast<std::uint64_t>(seed)).run();
    if (testing::Test::HasFailure()) return;
  }
}

}  // namespace
}  // namespace ridgecast::http
