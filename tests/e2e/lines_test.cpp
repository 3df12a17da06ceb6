// Bad lines and bad clients: a long line with jitter, a narrow one, clients that stop, never read, lie or are killed in the
// middle of a message. The mesh that is held has no hole, and the others are served on. STALL_SECONDS=30 stops them for so long; MEASURE=1,
// on a machine that does nothing else, wants nine tenths of the others' rate.

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "common/wire/wire.h"
#include "tests/support/quick_turn.h"
#include "tests/support/relay.h"
#include "tests/support/sanitized.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using Clock = std::chrono::steady_clock;

double secondsSince(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }

wire::Settings settings(double threshold, std::uint32_t budget = 100'000) {
  wire::Settings s;
  s.threshold = threshold;
  s.triangleBudget = budget;
  return s;
}

double residentMib(pid_t pid) {
  std::ifstream statm("/proc/" + std::to_string(pid) + "/statm");
  double total = 0, resident = 0;
  statm >> total >> resident;
  return resident * 4096 / (1 << 20);
}

TEST(Lines, AQuickTurnOverALongLineShowsNoHole) {
  ServerProcess server(RIDGECAST_SERVER);
  // 100 ms there and back, up to 10 ms more each way, 10 Mbit/s.
  Relay relay(server.port(), {.delay = 50ms, .jitter = 10ms, .bytesPerSecond = 1'250'000});
  Traveller client(relay.url(), settings(1));
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", client.line().world());
  // The round trip, jitter and 150 ms.
  expectQuickTurn(client, path, 250, 270);
  EXPECT_TRUE(server.healthy());
}

TEST(Lines, ANarrowLineCarriesAUsableWorld) {
  ServerProcess server(RIDGECAST_SERVER);
  Relay relay(server.port(), {.delay = 20ms, .bytesPerSecond = 64'000});
  wire::Settings asked = settings(0.6, 500'000);
  asked.bytesPerSecond = 60'000;
  Traveller client(relay.url(), asked);
  EXPECT_EQ(client.line().world().settings.bytesPerSecond, 60'000u);
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", client.line().world());
  const auto began = Clock::now();
  double firstView = 0;
  // Six seconds, and as many more as a slow machine takes for what the line could have carried long since.
  const auto usable = [&] { return client.scene().triangles() > 20'000 && client.latencies().size() > 12; };
  while (secondsSince(began) < 6 || (!usable() && Clock::now() < began + kTimeout)) {
    const camera::Camera camera = path.at(secondsSince(began));
    client.send(camera);
    ASSERT_TRUE(client.take(30ms)) << client.failure();
    if (client.scene().iteration() == 0) continue;
    if (firstView == 0) firstView = secondsSince(began);
    ASSERT_EQ(holes(client.scene(), camera.pose), 0);
  }
  EXPECT_EQ(client.mismatches(), 0u);
  if (measures()) {
    EXPECT_LT(firstView, 3);
    EXPECT_LT(secondsSince(began), 7);
  }
  EXPECT_GT(client.scene().triangles(), 20'000u) << "coarse, but not useless";
  EXPECT_GT(client.latencies().size(), 12u);
  EXPECT_LT(static_cast<double>(relay.bytesDown()), 64'000 * (secondsSince(began) + 1));
  RecordProperty("first_view_ms", static_cast<int>(firstView * 1e3));
  RecordProperty("p50_ms", static_cast<int>(percentile(client.latencies(), 0.5)));
  RecordProperty("triangles", static_cast<int>(client.scene().triangles()));
}

// ---- bad neighbours ----

class Neighbours : public testing::Test {
 protected:
  void SetUp() override {
    server_ = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{"--timeout", "2", "--window", "3"});
    good_ = std::make_unique<Traveller>(server_->url(), settings(2));
    EXPECT_EQ(good_->line().world().window, 3u);
    path_ = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", good_->line().world());
    began_ = Clock::now();
    fly(rest());
  }
  void TearDown() override {
    EXPECT_EQ(good_->mismatches(), 0u);
    EXPECT_EQ(good_->line().reconnections(), 0u);
    EXPECT_TRUE(server_->healthy());
  }

  static std::chrono::milliseconds rest() { return measures() ? 3s : 500ms; }  // for a rate that is worth comparing
  // The good client flies, ten poses a second; iterations a second that it got.
  double fly(std::chrono::milliseconds time) {
    const std::size_t before = good_->iterations();
    const auto start = Clock::now(), end = start + time;
    while (Clock::now() < end) {
      good_->send(path_->looped(secondsSince(began_)));
      const auto next = Clock::now() + 100ms;
      while (Clock::now() < next)
        EXPECT_TRUE(good_->take(std::chrono::duration_cast<std::chrono::milliseconds>(next - Clock::now()) + 1ms));
    }
    return static_cast<double>(good_->iterations() - before) / secondsSince(start);
  }

  // The good client got iterations all the while, and goes on to get them.
  void expectServed(double during, double before) {
    if (measures()) {
      EXPECT_GT(during, 0.9 * before);
    }
    const std::size_t now = good_->iterations();
    EXPECT_TRUE(await([&] { return fly(100ms), good_->iterations() >= now + 5; }));
  }

  std::string poseMessage(std::uint64_t sequence) {
    return wire::encode(wire::ClientMessage(wire::PoseMessage{sequence, path_->at(static_cast<double>(sequence % 40))}));
  }
  std::string helloMessage() {
    wire::Hello hello;
    hello.settings = settings(2);
    return wire::encode(wire::ClientMessage(hello));
  }

  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Traveller> good_;
  std::unique_ptr<PathCamera> path_;
  Clock::time_point began_;
};

TEST_F(Neighbours, ClientsThatStopOrNeverReadCostAFixedBound) {
  const double before = fly(rest()), memory = residentMib(server_->process().id());
  std::vector<std::unique_ptr<Relay>> relays;
  std::vector<std::unique_ptr<SocketClient>> clients;
  for (int k = 0; k < 6; ++k) {
    const bool stops = k % 2 == 0;
    if (stops) relays.push_back(std::make_unique<Relay>(server_->port(), Line{}));
    clients.push_back(std::make_unique<SocketClient>(stops ? relays.back()->port() : server_->port()));
    ASSERT_TRUE(clients.back()->upgrade());
    clients.back()->message(helloMessage());
    if (stops) relays.back()->hold(true);
  }
  // All keep asking.
  const char* const longer = std::getenv("STALL_SECONDS");
  const int seconds = longer ? std::max(1, std::atoi(longer)) : 6;
  std::uint64_t sequence = 0;
  double during = 0;
  for (int k = 0; k < seconds; ++k) {
    ++sequence;
    for (auto& c : clients) c->message(poseMessage(sequence));
    during += fly(1s) / seconds;
  }
  const double peak = residentMib(server_->process().id());
  expectServed(during, before);
  EXPECT_TRUE(kSanitized || peak < memory + 6 * 60) << memory << " MiB, then " << peak;
  clients.clear();
  relays.clear();
  const auto comesBack = [&] {
    return fly(500ms), kSanitized || residentMib(server_->process().id()) < memory + 0.5 * (peak - memory) + 30;
  };
  EXPECT_TRUE(await(comesBack)) << residentMib(server_->process().id());
  RecordProperty("rate_before", std::to_string(before));
  RecordProperty("rate_during", std::to_string(during));
  RecordProperty("mib_before_peak_after",
                 std::to_string(memory) + " " + std::to_string(peak) + " " + std::to_string(residentMib(server_->process().id())));
}

TEST_F(Neighbours, LiarsAreSentAwayAndTheOthersKeepTheirRate) {
  const double before = fly(rest());
  double during = 0;
  int sentAway = 0;
  for (int round = 0; round < 4; ++round) {
    std::vector<std::unique_ptr<SocketClient>> liars;
    for (int k = 0; k < 3; ++k) {
      liars.push_back(std::make_unique<SocketClient>(server_->port()));
      ASSERT_TRUE(liars.back()->upgrade());
      liars.back()->message(helloMessage());
      if (k == 2)
        liars.back()->message(
            wire::encode(wire::ClientMessage(wire::Resume{{{{0, 1, 2}, 77}, {{5, 0, 0}, 78}}, {}, 0})));  // holds none of it
      liars.back()->message(poseMessage(1));
    }
    during += fly(1s) / 4;
    liars[0]->message(wire::encode(wire::ClientMessage(wire::Acknowledge{1'000'000, 1})));  // was never sent
    for (std::uint64_t n = 1; n <= 40; ++n)                                                 // every hash wrong
      for (int k = 1; k < 3; ++k) liars[static_cast<std::size_t>(k)]->message(wire::encode(wire::ClientMessage(wire::Acknowledge{n, 5})));
    for (auto& liar : liars) {
      const int code = liar->awaitClose();
      sentAway += code == 1008 || code == 1002;
    }
  }
  EXPECT_EQ(sentAway, 12);
  expectServed(during, before);
}

TEST_F(Neighbours, ClientsKilledInMidMessageAreForgotten) {
  const double memory = residentMib(server_->process().id());
  for (int round = 0; round < 10; ++round) {
    Relay relay(server_->port(), {});
    std::vector<std::unique_ptr<SocketClient>> clients;
    for (int k = 0; k < 4; ++k) {
      clients.push_back(std::make_unique<SocketClient>(relay.port()));
      ASSERT_TRUE(clients.back()->upgrade());
      clients.back()->message(helloMessage());
      clients.back()->message(poseMessage(1));
      // Half a pose, announced whole.
      const std::string pose = poseMessage(2);
      clients.back()->frame(2, pose.substr(0, pose.size() / 2), true, pose.size());
    }
    fly(100ms);
    relay.breakAll();
    fly(100ms);
  }
  EXPECT_TRUE(await([&] { return fly(500ms), kSanitized || residentMib(server_->process().id()) < memory + 40; }))
      << residentMib(server_->process().id());
  RecordProperty("mib_before_after", std::to_string(memory) + " " + std::to_string(residentMib(server_->process().id())));
}

}  // namespace
}  // namespace ridgecast
