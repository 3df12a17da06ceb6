// Connections that are lost: a server that is killed and comes back on its port, and a line that breaks while the server lives. Nobody
// restarts a client, and all hold the right mesh again (MEASURE=1: within five seconds).

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/link/client.h"
#include "tests/support/process.h"
#include "tests/support/relay.h"
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

TEST(Resume, ALineThatBreaksCostsOnlyWhatIsMissing) {
  ServerProcess server(RIDGECAST_SERVER);
  Relay relay(server.port(), {});
  Traveller client(relay.url(), coarse());
  const PathCamera path(RIDGECAST_PATHS "/alpine.json", client.line().world());
  const auto rest = [&] {
    client.send(path.at(0));
    for (const auto until = Clock::now() + kTimeout; Clock::now() < until && !client.settled();) client.take(50ms);
    return client.settled();
  };
  ASSERT_TRUE(rest());
  const std::uint64_t hash = client.scene().hash();
  const std::size_t before = client.wholes(), leaves = client.scene().leaves().size();
  relay.breakAll();
  for (const auto until = Clock::now() + kTimeout; Clock::now() < until && client.line().reconnections() == 0;) client.take(20ms);
  ASSERT_EQ(client.line().reconnections(), 1u);
  ASSERT_TRUE(rest());
  EXPECT_EQ(client.mismatches(), 0u);
  // The same pose comes to the same mesh again: next to nothing is sent.
  EXPECT_LT(client.wholes() - before, leaves / 10);
  EXPECT_EQ(client.scene().leaves().size(), leaves);
  EXPECT_EQ(client.scene().hash(), hash);
  EXPECT_TRUE(server.healthy());
}

// Without --state a session's edits end with the server: what a client knows of them is no ground of the new session.
TEST(Resume, AServerWithoutTheEditsThatAClientKnowsHasAnotherWorld) {
  for (const bool keeps : {false, true}) {
    const ScratchFolder folder;
    const std::vector<std::string> options = keeps ? std::vector<std::string>{"--state", folder / "state"} : std::vector<std::string>{};
    auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, options);
    const std::uint16_t port = server->port();
    wire::Hello hello;
    hello.settings = coarse();
    const auto client = link::Client::open(core::parseUrl(server->url()).value(), hello).value();
    const auto edit = client->connection().edit({0, "", R"({"op":"crater","x":40,"z":60,"radius":20,"depth":5})"}).get();
    ASSERT_TRUE(edit) << edit.error().message;
    server->process().signal(SIGKILL);
    server->process().wait(kTimeout);
    server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, options, port);
    const link::Connection& connection = client->connection();
    EXPECT_TRUE(await([&] {
      client->connection().change({.threshold = 5});  // while it is lost, and while it comes back
      client->receive(5ms);
      return connection.otherWorld() || connection.reconnections() > 0;
    }));
    EXPECT_EQ(connection.otherWorld(), !keeps);
    if (!keeps) {
      ASSERT_TRUE(connection.error());
      EXPECT_EQ(connection.error()->message, "the server has lost edits of this world");
      continue;
    }
    EXPECT_EQ(client->world().edit, 1u);
    client->send(PathCamera(RIDGECAST_PATHS "/alpine.json", client->world()).at(0));
    EXPECT_TRUE(await([&] { return client->receive(5ms), connection.granted().threshold == 5; }));
  }
}

}  // namespace
}  // namespace ridgecast
