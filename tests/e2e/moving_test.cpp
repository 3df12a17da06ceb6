// Cameras in flight move from a server that drains to another one, with Redis between them: their meshes go with them, and only what
// changes is sent (MEASURE=1: nobody waits for longer than 0.3 s).
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
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

// Polls at 60 frames a second, in its own thread as a client's owner does.
class Guest {
 public:
  struct Figures {
    bool settled = false;
    std::uint64_t bytes = 0, reconnections = 0;
    std::uint64_t firstBytes = 0;  // of the first iteration of the connection
    std::size_t firstLeaves = 0;   // that it brought
    Clock::duration longest{};     // between two iterations, since forgetLongest()
  };

  Guest(const std::string& url, int k) : offset_(3 * k) {
    wire::Hello hello;
    hello.settings.threshold = 3;
    client_ = link::Client::open(core::parseUrl(url).value(), hello).value();
    thread_ = std::jthread([this](const std::stop_token& ends) { run(ends); });
  }

  void fly() { flies_ = true; }
  Figures figures() const {
    const std::lock_guard lock(mutex_);
    return figures_;
  }
  void forgetLongest() {
    const std::lock_guard lock(mutex_);
    figures_.longest = {};
  }

 private:
  void run(const std::stop_token& ends) {
    const PathCamera path(RIDGECAST_PATHS "/alpine.json", client_->world());
    client_->send(path.looped(offset_));
    for (std::optional<Clock::time_point> began; !ends.stop_requested(); std::this_thread::sleep_for(16ms)) {
      if (flies_ && !began) began = Clock::now();
      if (began) client_->send(path.looped(offset_ + std::chrono::duration<double>(Clock::now() - *began).count()));
      while (const std::optional<link::Update> update = client_->receive(0ms)) take(*update);
    }
  }

  void take(const link::Update& update) {
    EXPECT_FALSE(update.wrong) << update.wrong->message;
    const std::lock_guard lock(mutex_);
    const auto now = Clock::now();
    if (heard_ != Clock::time_point{}) figures_.longest = std::max(figures_.longest, now - heard_);
    heard_ = now;
    figures_.bytes += update.bytes;
    figures_.settled = update.iteration.settled;
    figures_.reconnections = client_->connection().reconnections();
    if (update.iteration.number != 1) return;
    figures_.firstBytes = update.bytes;
    figures_.firstLeaves = update.iteration.whole.size() + update.iteration.come.size();
  }

  const double offset_;
  std::unique_ptr<link::Client> client_;
  std::atomic<bool> flies_{false};
  mutable std::mutex mutex_;
  Figures figures_;
  Clock::time_point heard_{};
  std::jthread thread_;
};

TEST(Moving, SixteenFlyingCamerasMoveWithTheirMeshes) {
  if (!RedisServer::exists()) GTEST_SKIP() << "no redis-server here";
  const RedisServer redis;
  ServerProcess second(RIDGECAST_SERVER, {"--shared", redis.url()});
  ServerProcess first(RIDGECAST_SERVER, {"--shared", redis.url(), "--reconnect-url", second.url()});
  std::vector<std::unique_ptr<Guest>> guests;
  for (int k = 0; k < 16; ++k) guests.push_back(std::make_unique<Guest>(first.url(), k));
  const auto every = [&](const std::function<bool(const Guest::Figures&)>& is) {
    return await([&] { return std::ranges::all_of(guests, [&](const auto& guest) { return is(guest->figures()); }); });
  };
  ASSERT_TRUE(every([](const auto& of) { return of.settled; }));
  std::vector<std::uint64_t> start;
  for (const auto& guest : guests) start.push_back(guest->figures().bytes);
  for (const auto& guest : guests) guest->fly();
  std::this_thread::sleep_for(2s);
  for (const auto& guest : guests) guest->forgetLongest();
  first.process().signal(SIGUSR1);
  ASSERT_TRUE(every([](const auto& of) { return of.reconnections == 1 && of.firstBytes > 0; }));
  std::this_thread::sleep_for(1s);
  double share = 0;
  std::vector<double> longest;
  for (std::size_t k = 0; k < guests.size(); ++k) {
    const Guest::Figures of = guests[k]->figures();
    EXPECT_EQ(of.reconnections, 1u);
    EXPECT_EQ(of.firstLeaves, 0u) << "it goes on";
    share = std::max(share, static_cast<double>(of.firstBytes) / static_cast<double>(start[k]));
    longest.push_back(std::chrono::duration<double, std::milli>(of.longest).count());
  }
  std::ranges::sort(longest);
  EXPECT_LE(share, 0.05) << "of a start";
  std::printf("at most %.1f %% of a start's %llu bytes, %.0f ms between two iterations (median %.0f)\n", 100 * share,
              static_cast<unsigned long long>(start[0]), longest.back(), longest[longest.size() / 2]);
  if (measures()) {
    EXPECT_LT(longest.back(), 300);
  }
  EXPECT_TRUE(second.healthy());
}

}  // namespace
}  // namespace ridgecast
