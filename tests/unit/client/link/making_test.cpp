// A connection to a session that the server has to make first.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <stop_token>
#include <string>
#include <thread>

#include "client/link/connection.h"
#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_server.h"
#include "tests/unit/client/link/talking.h"

namespace ridgecast::link {
namespace {

using namespace std::chrono_literals;
using test::RawConnection;
using test::RawServer;
using Clock = std::chrono::steady_clock;
using testing_support::kTimeout;

// A session that the server has to make first.
core::Url making(const std::string& port) {
  core::Url url = at(port);
  url.world = "terrain=slow&seed=2";
  return url;
}
const std::string kWord = "HTTP/1.1 102 Processing\r\nProgress: preparing the terrain\r\n\r\n";

TEST(Connection, AWorldThatIsBeingMadeIsWaitedForAsLongAsTheServerSaysSo) {
  RawServer server([](RawConnection& peer) {
    // Torn anywhere, and several at once.
    for (std::size_t cut = 0; cut <= kWord.size(); cut += 9) {
      peer.send(kWord.substr(0, cut));
      std::this_thread::sleep_for(30ms);
      peer.send(kWord.substr(cut));
    }
    peer.send(kWord + kWord + kWord);
    peer.upgrade();
    peer.readFrame();
    peer.sendFrame(worldBytes());
    peer.drain();
  });
  std::atomic<std::size_t> words = 0;
  const auto connection = Connection::open(
      making(server.port()), {}, {.timeout = kTimeout, .waiting = {.unheard = kTimeout, .heard = kTimeout, .preparing = [&] { ++words; }}});
  ASSERT_TRUE(connection) << connection.error().message;
  EXPECT_EQ((*connection)->world().seed, 3u);
  EXPECT_EQ(words, kWord.size() / 9 + 1 + 3);
}

TEST(Connection, EachWordIsNewPatience) {
  RawServer server([](RawConnection& peer) {
    for (int k = 0; k < 12; ++k) {
      peer.send(kWord);
      std::this_thread::sleep_for(100ms);
    }
    peer.drain();
  });
  const auto began = Clock::now();
  expectContains(errorOf(making(server.port()), 1s, {.unheard = kTimeout, .heard = 700ms}),
                 "said nothing more within 700 ms; try again later");
  EXPECT_GE(Clock::now() - began, 1800ms);  // after the twelfth
}

TEST(Connection, AServerWithoutAWordOfTheWorldHasOnlyTheTimeOfItsKind) {
  const auto drain = [](RawConnection& peer) { peer.drain(); };
  {
    RawServer server(drain);
    expectContains(errorOf(making(server.port()), 1s, {.unheard = 1500ms, .heard = kTimeout}),
                   "did not answer like a Ridgecast server within 1500 ms");
  }
  RawServer server(drain);  // there is nothing to be made
  expectContains(errorOf(at(server.port()), 200ms, {.unheard = kTimeout, .heard = kTimeout}), "within 200 ms");
}

TEST(Connection, AServerThatDiesWhileItMakesTheWorld) {
  RawServer server([](RawConnection& peer) {
    peer.readHead();
    peer.send(kWord);
  });
  expectContains(errorOf(making(server.port())), "went away while it prepared the terrain");
}

TEST(Connection, AWorldThatCannotBeMadeIsToldInTheServersWords) {
  RawServer server([](RawConnection& peer) {
    peer.readHead();
    peer.send(kWord + "HTTP/1.1 400 Bad Request\r\nContent-Length: 20\r\n\r\nslow.glsl, line 3: x\n");
    peer.drain();
  });
  expectContains(errorOf(making(server.port())), "slow.glsl, line 3: x");
}

TEST(Connection, WaitingIsGivenUpAtOnce) {
  for (const bool heard : {false, true}) {
    std::promise<void> waits;
    RawServer server([&](RawConnection& peer) {
      peer.readHead();
      heard ? peer.send(kWord) : waits.set_value();
      peer.drain();
    });
    std::stop_source stop;
    std::atomic<bool> told = false;
    const Waiting waiting{.unheard = kTimeout,
                          .heard = kTimeout,
                          .preparing =
                              [&] {
                                if (!told.exchange(true)) waits.set_value();
                              },
                          .stop = stop.get_token()};
    auto error = std::async(std::launch::async, [&] { return errorOf(making(server.port()), kTimeout, waiting); });
    waits.get_future().wait();
    stop.request_stop();
    ASSERT_EQ(error.wait_for(kTimeout / 2), std::future_status::ready);
    expectContains(error.get(), "gave up");
  }
}

}  // namespace
}  // namespace ridgecast::link
