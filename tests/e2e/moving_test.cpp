// Cameras in flight move from a server that drains to another one, with Redis between them: their meshes go with them, and only what
// changes is sent (MEASURE=1: nobody waits for longer than 0.3 s).
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/link/client.h"
#include "tests/support/flier.h"
#include "tests/support/process.h"
#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using Clock = std::chrono::steady_clock;

struct Guest {
  Guest(const std::string& url, int k) : offset(3 * k) {
    wire::Hello hello;
    hello.settings.threshold = 3;
    client = link::Client::open(core::parseUrl(url).value(), hello).value();
  }
  void send(const PathCamera& path, double t) { client->send(path.looped(t + offset)); }
  void take() {
    while (const auto update = client->receive(0ms)) {
      EXPECT_FALSE(update->wrong) << update->wrong->message;
      const auto now = Clock::now();
      if (heard != Clock::time_point{}) longest = std::max(longest, now - heard);
      heard = now;
      bytes += update->bytes;
      settled = update->iteration.settled;
      if (update->iteration.number != 1) continue;
      firstBytes = update->bytes;
      firstLeaves = update->iteration.whole.size() + update->iteration.come.size();
    }
  }

  const double offset;
  std::unique_ptr<link::Client> client;
  bool settled = false;
  std::uint64_t bytes = 0, firstBytes = 0, start = 0;
  std::size_t firstLeaves = 0;  // that the first iteration of the connection brought
  Clock::time_point heard{};
  Clock::duration longest{};  // between two iterations
};

class Guests {
 public:
  Guests(const std::string& url, int count) {
    for (int k = 0; k < count; ++k) all_.push_back(std::make_unique<Guest>(url, k));
    path_ = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", all_[0]->client->world());
  }
  // Until it is so; false when that does not come.
  bool hover(const std::function<bool()>& until) { return run(false, until); }
  bool fly(const std::function<bool()>& until) { return run(true, until); }
  bool flyFor(std::chrono::milliseconds time) {
    const auto end = Clock::now() + time;
    return fly([&] { return Clock::now() > end; });
  }
  bool every(const std::function<bool(Guest&)>& is) const {
    return std::ranges::all_of(all_, [&](const auto& g) { return is(*g); });
  }
  const std::vector<std::unique_ptr<Guest>>& all() const { return all_; }

 private:
  bool run(bool moves, const std::function<bool()>& until) {
    for (const auto end = Clock::now() + kTimeout; !until();) {
      if (Clock::now() > end) return false;
      if (moves || !hasPose_) {
        for (const auto& guest : all_) guest->send(*path_, time_);
        time_ += moves ? 0.03 : 0;
        hasPose_ = true;
      }
      for (const auto& guest : all_) guest->take();
      std::this_thread::sleep_for(30ms);
    }
    return true;
  }
  std::vector<std::unique_ptr<Guest>> all_;
  std::unique_ptr<PathCamera> path_;
  double time_ = 0;
  bool hasPose_ = false;
};

TEST(Moving, SixteenFlyingCamerasMoveWithTheirMeshes) {
  if (!RedisServer::exists()) GTEST_SKIP() << "no redis-server here";
  const RedisServer redis;
  ServerProcess second(RIDGECAST_SERVER, {"--shared", redis.url()});
  ServerProcess first(RIDGECAST_SERVER, {"--shared", redis.url(), "--reconnect-url", second.url()});
  Guests guests(first.url(), 16);
  ASSERT_TRUE(guests.hover([&] { return guests.every([](Guest& g) { return g.settled; }); }));
  for (const auto& guest : guests.all()) guest->start = guest->bytes;
  ASSERT_TRUE(guests.flyFor(2s));
  for (const auto& guest : guests.all()) guest->longest = {};
  first.process().signal(SIGUSR1);
  ASSERT_TRUE(
      guests.fly([&] { return guests.every([](Guest& g) { return g.client->connection().reconnections() == 1 && g.firstBytes > 0; }); }));
  ASSERT_TRUE(guests.flyFor(1s));
  double share = 0;
  Clock::duration longest{};
  for (const auto& guest : guests.all()) {
    EXPECT_EQ(guest->client->connection().reconnections(), 1u);
    EXPECT_EQ(guest->firstLeaves, 0u) << "it goes on";
    share = std::max(share, static_cast<double>(guest->firstBytes) / static_cast<double>(guest->start));
    longest = std::max(longest, guest->longest);
  }
  EXPECT_LE(share, 0.05) << "of a start";
  const double milliseconds = std::chrono::duration<double, std::milli>(longest).count();
  std::printf("at most %.1f %% of a start's %llu bytes, %.0f ms between two iterations\n", 100 * share,
              static_cast<unsigned long long>(guests.all()[0]->start), milliseconds);
  if (measures()) {
    EXPECT_LT(milliseconds, 300);
  }
  EXPECT_TRUE(second.healthy());
}

}  // namespace
}  // namespace ridgecast
