// A connection against servers that are not there, are something else, are late, lie, or go away.
#include "client/link/connection.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <stop_token>
#include <thread>

#include "common/wire/wire.h"
#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_server.h"
#include "tests/unit/client/link/talking.h"

namespace ridgecast::link {
namespace {

using namespace std::chrono_literals;
using namespace std::string_literals;
using test::RawConnection;
using test::RawServer;
using Clock = std::chrono::steady_clock;
using testing_support::kTimeout;

std::string iterationBytes(std::uint64_t number) {
  wire::Iteration it;
  it.number = number;
  return wire::encode(wire::ServerMessage(it));
}
// The client's next message, which must be one of these.
template <class Message>
Message read(RawConnection& peer) {
  const std::string frame = peer.readFrame();
  const auto decoded = wire::decodeClient({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()});
  if (decoded && std::holds_alternative<Message>(*decoded)) return std::get<Message>(*decoded);
  ADD_FAILURE() << "not the message that should come: " << (decoded ? "another kind" : decoded.error().message);
  return {};
}

TEST(Connection, NobodyListens) {
  const std::string port = test::closedPort();
  expectContains(errorOf(at(port)), "no server at 127.0.0.1:" + port + "; start one with ridgecast-server --port " + port);
}

TEST(Connection, HostUnknown) {
  expectContains(errorOf({.host = "no-such-host.invalid", .port = "7070", .session = "default"}), "no-such-host.invalid");
}

TEST(Connection, ServerThatIsSilent) {
  RawServer server([](RawConnection& peer) { peer.drain(); });
  expectContains(errorOf(at(server.port()), 200ms), "did not answer like a Ridgecast server within 200 ms");
}

TEST(Connection, ServerThatUpgradesAndIsSilent) {
  RawServer server([](RawConnection& peer) {
    peer.upgrade();
    peer.drain();
  });
  expectContains(errorOf(at(server.port()), 200ms), "did not answer");
}

TEST(Connection, ServerThatIsSomethingElse) {
  for (const std::string& greeting :
       {std::string("SSH-2.0-OpenSSH_9.2\r\n"), "\x16\x03\x01\x02\0garbage\r\n\r\n"s, std::string(3000, '\xff') + "\r\n\r\n"}) {
    RawServer server([&](RawConnection& peer) {
      peer.send(greeting);
      peer.drain();
    });
    expectContains(errorOf(at(server.port()), 500ms), "Ridgecast server");
  }
}

TEST(Connection, ServerThatHangsUp) {
  RawServer server([](RawConnection& peer) { peer.readHead(); });
  expectContains(errorOf(at(server.port())), "not a Ridgecast server");
}

TEST(Connection, HttpServerWithoutAStream) {
  RawServer server([](RawConnection& peer) {
    peer.readHead();
    peer.send("HTTP/1.1 404 Not Found\r\nContent-Length: 24\r\n\r\nno session of that name\n");
    peer.drain();
  });
  const std::string error = errorOf(at(server.port()));
  expectContains(error, "HTTP 404");
  expectContains(error, "no session of that name");
}

TEST(Connection, ServerThatRefusesForAWhileIsAskedAgain) {
  int asked = 0;
  {
    RawServer server(
        [&](RawConnection& peer) {
          peer.readHead();
          peer.send(++asked == 3
                        ? "HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n"
                        : "HTTP/1.1 503 Busy\r\nRetry-After: " + std::to_string(asked - 1) + "\r\nContent-Length: 5\r\n\r\nbusy\n");
          peer.drain();
        },
        3);
    expectContains(errorOf(at(server.port())), "HTTP 404");
  }
  EXPECT_EQ(asked, 3);
  for (const char* late : {"31", "-1", "soon", "4294967295"}) {
    RawServer server([&](RawConnection& peer) {
      peer.readHead();
      peer.send("HTTP/1.1 503 Busy\r\nRetry-After: " + std::string(late) + "\r\nContent-Length: 5\r\n\r\nbusy\n");
      peer.drain();
    });
    expectContains(errorOf(at(server.port())), "HTTP 503 instead of opening a stream: busy");
  }
}

TEST(Connection, AsksForTheSessionOfTheUrl) {
  std::string head;
  {
    RawServer server([&](RawConnection& peer) { head = peer.readHead(); });
    errorOf({.host = "127.0.0.1", .port = server.port(), .session = "race-1"});
  }
  expectContains(head, "GET /v1/stream?session=race-1 HTTP/1.1\r\n");
}

TEST(Connection, ServerThatClosesWithAReason) {
  RawServer server([](RawConnection& peer) {
    peer.upgrade();
    peer.readFrame();
    peer.sendClose(1013, "full, try again later");
    peer.drain();
  });
  expectContains(errorOf(at(server.port())), "full, try again later");
}

TEST(Connection, ServerThatTalksNonsense) {
  const std::string iteration = iterationBytes(1);
  struct Case {
    std::string bytes;
    int opcode;
    const char* error;
  };
  for (const Case& c :
       {Case{"hello", 1, "text"}, Case{"garbage", 2, "cannot be read"}, Case{iteration, 2, "before its world"}, Case{"x", 5, "stream"}}) {
    RawServer server([&](RawConnection& peer) {
      peer.upgrade();
      peer.readFrame();
      peer.sendFrame(c.bytes, c.opcode);
      peer.drain();
    });
    expectContains(errorOf(at(server.port())), c.error);
  }
}

// A server that greets and then plays on.
struct Greeted {
  explicit Greeted(const std::function<void(RawConnection&)>& then)
      : server([=](RawConnection& peer) {
          peer.upgrade();
          peer.readFrame();
          peer.sendFrame(worldBytes());
          then(peer);
        }) {
    auto opened = Connection::open(at(server.port()), wire::Hello{}, {.reconnects = false, .timeout = kTimeout});
    EXPECT_TRUE(opened) << opened.error().message;
    if (opened) connection = std::move(*opened);
  }
  RawServer server;  // declared first: outlives the connection, so its script sees the end
  std::unique_ptr<Connection> connection;
};

void expectEndsWith(Connection& connection, const std::string& part) {
  while (connection.receive(kTimeout)) {
  }
  ASSERT_TRUE(connection.error());
  expectContains(connection.error()->message, part);
}

TEST(Connection, SaysHelloAndHoldsTheWorld) {
  std::promise<wire::Hello> first;
  RawServer server([&](RawConnection& peer) {
    peer.upgrade();
    first.set_value(read<wire::Hello>(peer));
    peer.sendFrame(worldBytes());
    peer.drain();
  });
  const wire::Hello hello{.clientName = "a test", .settings = {wire::Metric::kPixels, 2, 3}, .pacing = wire::Pacing::kLockstep};
  const auto connection = Connection::open(at(server.port()), hello, {.reconnects = false, .timeout = kTimeout});
  ASSERT_TRUE(connection) << connection.error().message;
  EXPECT_EQ((*connection)->world().terrainName, "alpine");
  EXPECT_EQ((*connection)->world().window, 3u);
  EXPECT_FALSE((*connection)->error());
  EXPECT_FALSE((*connection)->receive(0ms));
  const wire::Hello sent = first.get_future().get();
  EXPECT_EQ(sent.clientName, "a test");
  EXPECT_EQ(sent.settings.threshold, 2);
  EXPECT_EQ(sent.pacing, wire::Pacing::kLockstep);
}

TEST(Connection, PartsQuicklyWhileItIsLost) {
  for (const bool someoneIsThere : {false, true}) {
    std::promise<void> again;
    std::atomic<int> peers = 0;
    auto server = std::make_unique<RawServer>(
        [&](RawConnection& peer) {
          if (++peers > 1) {
            again.set_value();
            return peer.drain();  // it does not say a word
          }
          peer.upgrade();
          peer.readFrame();
          peer.sendFrame(worldBytes());
        },
        someoneIsThere ? 2 : 1);
    auto connection = Connection::open(at(server->port()), {}, {.timeout = kTimeout});
    ASSERT_TRUE(connection) << connection.error().message;
    if (!someoneIsThere) server.reset();
    EXPECT_TRUE(testing_support::await([&] { return (*connection)->error().has_value(); }));
    std::this_thread::sleep_for(2 * core::Reconnector::kFirstPause);
    EXPECT_EQ(peers, 1) << "it comes back for nobody";
    EXPECT_FALSE((*connection)->receive(20ms));
    if (someoneIsThere) again.get_future().wait();
    EXPECT_FALSE((*connection)->ask({}).get());
    const auto before = Clock::now();
    connection->reset();
    EXPECT_LT(Clock::now() - before, testing_support::measures() ? 1s : kTimeout);
  }
}

TEST(Connection, ServerThatGoesAway) {
  Greeted midFrame([](RawConnection& peer) { peer.send("\x82\x7e\x10\x00half of it"s); });
  expectEndsWith(*midFrame.connection, "went away without a goodbye");
  Greeted polite([](RawConnection& peer) {
    peer.sendClose(1001, "the server stops");
    peer.drain();
  });
  expectEndsWith(*polite.connection, "the server stops");
  Greeted error([](RawConnection& peer) {
    peer.sendFrame(wire::encode(wire::ServerMessage(wire::ErrorMessage{wire::ErrorCode::kInvalid, "Pose.x is wrong"})));
    peer.drain();
  });
  expectEndsWith(*error.connection, "Pose.x is wrong");
  error.connection->send({.sequence = 1, .camera = {}});  // into the void, harmless
  EXPECT_FALSE(error.connection->receive(0ms));
}

TEST(Connection, ServerThatAnnouncesAFrameTooLarge) {
  Greeted g([](RawConnection& peer) {
    peer.send("\x82\x7f\0\0\x01\0\0\0\0\0"s);  // a terabyte
    peer.drain();
  });
  expectEndsWith(*g.connection, "more than 256 MiB");
}

TEST(Connection, PartsQuicklyFromAServerThatDoesNotAnswer) {
  std::promise<void> over;
  std::shared_future<void> wait(over.get_future());
  Greeted g([wait](RawConnection&) { wait.wait(); });
  const auto before = Clock::now();
  g.connection.reset();
  EXPECT_LT(Clock::now() - before, testing_support::measures() ? 1s : kTimeout);
  over.set_value();
}

TEST(Connection, PartsPolitely) {
  std::promise<bool> closed;
  {
    Greeted g([&](RawConnection& peer) {
      closed.set_value(peer.readFrame().empty());
      peer.sendClose(1000, "");
      peer.drain();
    });
  }
  EXPECT_TRUE(closed.get_future().get());
}

}  // namespace
}  // namespace ridgecast::link
