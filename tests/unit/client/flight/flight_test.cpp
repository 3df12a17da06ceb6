// A flight against servers that answer honestly, settle late, or hang up in the middle. (With pictures: ../evaluation/fly_test.cpp; real
// servers: tests/e2e/fly_test.cpp.)
#include "client/flight/flight.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "common/wire/wire.h"
#include "tests/unit/client/link/raw_world.h"

namespace ridgecast::flight {
namespace {

using test::RawConnection;
using test::RawServer;

// Greets and answers every pose with an empty iteration; hangs up after `most`. Poses of path times from `settledFrom` on are at rest.
struct Script {
  std::uint64_t settledFrom = 0, most = ~std::uint64_t{0};  // iterations
  std::vector<std::uint64_t> poses;

  void operator()(RawConnection& peer) {
    peer.upgrade();
    peer.readFrame();
    peer.sendFrame(wire::encode(wire::ServerMessage(test::rawWorld())));
    std::uint64_t number = 0;
    for (std::string frame = peer.readFrame(); !frame.empty(); frame = peer.readFrame()) {
      const auto message = wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()});
      const auto* pose = message ? std::get_if<wire::PoseMessage>(&*message) : nullptr;
      if (!pose) continue;
      if (++number > most) return;
      poses.push_back(pose->sequence);
      wire::Iteration iteration;
      iteration.number = number;
      iteration.poseSequence = pose->sequence;
      iteration.settled = number >= settledFrom;
      peer.sendFrame(wire::encode(wire::ServerMessage(iteration)));
    }
  }
};

struct Seen final : Observer {
  std::vector<double> iterations;  // path times
  int reachedPlaces = 0, most = 1000;
  Outcome<void> iterated(const link::Update& update, double t, double latencyMs) override {
    EXPECT_FALSE(update.wrong);
    EXPECT_GE(latencyMs, 0);
    iterations.push_back(t);
    return {};
  }
  Outcome<void> reached() override {
    if (++reachedPlaces >= most) return Error{"the observer has had enough"};
    return {};
  }
};

camera::Path path() {
  return *camera::parsePath(R"({"keyframes": [{"t": 0, "x": 0, "z": 0, "altitude": 100, "yaw": 0, "pitch": -10},
                                              {"t": 1, "x": 10, "z": 0, "altitude": 100, "yaw": 0, "pitch": -10}]})");
}

struct Flown {
  explicit Flown(const RawServer& server, const Options& options = {.rate = 5, .settleLimit = 20}) {
    wire::Hello hello;
    hello.pacing = options.realtime ? wire::Pacing::kFree : wire::Pacing::kLockstep;
    client = link::Client::open({.port = server.port()}, hello, {.reconnects = options.realtime}).value();
    flight = std::make_unique<Flight>(
        options, path(), *client, [this](lattice::Point) { return ground; }, seen);
  }
  Seen seen;
  Outcome<double> ground = 50.0;
  std::unique_ptr<link::Client> client;
  std::unique_ptr<Flight> flight;
};

TEST(Flight, InLockStepHasOneIterationAPose) {
  Script script{.settledFrom = 9, .poses = {}};
  RawServer server(std::ref(script));
  {
    Flown f(server);
    ASSERT_TRUE(f.flight->fly());
    EXPECT_EQ(f.seen.reachedPlaces, 6);
    ASSERT_EQ(f.seen.iterations.size(), 6u);
    for (std::size_t k = 0; k < 6; ++k) EXPECT_DOUBLE_EQ(f.seen.iterations[k], 0.2 * static_cast<double>(k));
    EXPECT_EQ(f.flight->camera().pose.y, 150);
    EXPECT_EQ(f.flight->camera().pose.x, 10 * 256);
    const auto settled = f.flight->settle();  // three more at the last place
    ASSERT_TRUE(settled);
    EXPECT_TRUE(*settled);
    EXPECT_EQ(f.seen.iterations.size(), 9u);
    EXPECT_EQ(f.seen.iterations.back(), 1);
    EXPECT_EQ(f.seen.reachedPlaces, 6);
    EXPECT_GT(f.flight->seconds(), 0);
  }
  EXPECT_EQ(script.poses, (std::vector<std::uint64_t>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
}

TEST(Flight, SaysThatItDidNotSettle) {
  Script script{.settledFrom = ~std::uint64_t{0}, .poses = {}};
  RawServer server(std::ref(script));
  Flown f(server, {.rate = 5, .settleLimit = 0.05});
  ASSERT_TRUE(f.flight->fly());
  const auto settled = f.flight->settle();
  ASSERT_TRUE(settled);
  EXPECT_FALSE(*settled);
}

TEST(Flight, EndsWithItsConnectionItsGroundOrItsObserver) {
  Script script{.most = 3, .poses = {}};
  {
    RawServer server(std::ref(script));
    Flown f(server);
    const auto flown = f.flight->fly();
    ASSERT_FALSE(flown);
    EXPECT_EQ(f.seen.iterations.size(), 3u);
  }
  RawServer server(std::ref(script), 2);
  {
    Flown f(server);
    f.ground = Error{"no ground"};
    EXPECT_EQ(f.flight->place(0).error().message, "no ground");
    EXPECT_EQ(f.flight->fly().error().message, "no ground");
  }
  Flown f(server);
  f.seen.most = 2;
  EXPECT_EQ(f.flight->fly().error().message, "the observer has had enough");
}

TEST(Flight, ByTheClockGoesOnWhenTheConnectionComesBack) {
  Script script{.most = 5, .poses = {}};
  RawServer server(
      [&](RawConnection& peer) {
        script(peer);
        script.most = 1000;
      },
      2);
  Flown f(server, {.realtime = true, .settleLimit = 60});
  ASSERT_TRUE(f.flight->fly());
  const auto settled = f.flight->settle();
  ASSERT_TRUE(settled) << settled.error().message;
  EXPECT_TRUE(*settled);
  EXPECT_EQ(f.client->connection().reconnections(), 1u);
  EXPECT_GT(f.seen.iterations.size(), 5u);
  EXPECT_GE(f.flight->seconds(), 1);
}

}  // namespace
}  // namespace ridgecast::flight
