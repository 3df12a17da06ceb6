// A member of a session at a server that plays a script. (With a real one: tests/integration/world_test.cpp.)
#include "client/world/world.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <thread>

#include "common/wire/wire.h"
#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_world.h"

namespace ridgecast::world {
namespace {

using namespace std::chrono_literals;
using test::RawConnection;
using testing_support::kTimeout;

void greet(RawConnection& peer) {
  peer.upgrade();
  peer.readFrame();  // hello
  peer.sendFrame(wire::encode(wire::ServerMessage(test::rawWorld())));
}
void tellTime(RawConnection& peer, std::chrono::seconds time) {
  const wire::Clock clock{.rate = 1, .time = static_cast<std::uint64_t>(std::chrono::microseconds(time).count())};
  peer.sendFrame(wire::encode(wire::ServerMessage(clock)));
}

// Between a world and its clock, 0 was read of a clock that goes on.
TEST(World, KnowsTheClockFromTheFirstMomentOnAndWhenItIsBack) {
  std::promise<void> leaves, tells;
  test::RawServer server(
      [&, is = 0](RawConnection& peer) mutable {
        greet(peer);
        if (++is == 1) {
          std::this_thread::sleep_for(50ms);
          tellTime(peer, 9s);
          leaves.get_future().wait();
        } else {
          tells.get_future().wait();
          tellTime(peer, 20s);
          peer.drain();
        }
      },
      2);
  const auto seconds = [](World& world) { return static_cast<double>(world.clock().time(std::chrono::steady_clock::now())) / 1e6; };
  auto joined = World::join("ws://127.0.0.1:" + server.port(), {.camera = false, .timeout = kTimeout});
  ASSERT_TRUE(joined) << joined.error().message;
  World& world = **joined;
  EXPECT_GE(seconds(world), 9);
  leaves.set_value();
  EXPECT_TRUE(testing_support::await([&] { return world.clock(), world.reconnections() == 1; }));
  EXPECT_GE(seconds(world), 9);
  EXPECT_LT(seconds(world), 20);
  tells.set_value();
  EXPECT_TRUE(testing_support::await([&] { return seconds(world) >= 20; }));
}

}  // namespace
}  // namespace ridgecast::world
