// Two servers beside Redis and behind HAProxy, with the configurations that docker/ ships: each new stream goes to the server with the
// fewest, every session is reached through any of them, and a server that is drained, ended or killed loses its clients to the other, with
// the right mesh, without any client being started again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/traveller.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using Clock = std::chrono::steady_clock;

wire::Settings coarse() {
  wire::Settings s;
  s.threshold = 8;
  return s;
}

std::string get(std::uint16_t port, const std::string& target, const std::string& method = "GET") {
  SocketClient client(port);
  client.send(method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  return client.answer();
}

// A figure without labels.
double figure(std::uint16_t port, const std::string& name) {
  const std::string text = get(port, "/metrics");
  const auto at = text.find("\n" + name + " ");
  return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
}

class Balance : public testing::Test {
 protected:
  void SetUp() override {
    if (!programExists("haproxy") && !std::filesystem::exists("/usr/sbin/haproxy")) GTEST_SKIP() << "haproxy is not installed";
    if (!RedisServer::exists()) GTEST_SKIP() << "redis-server is not installed";
    redis.emplace();
    for (auto& server : servers)
      server = std::make_unique<ServerProcess>(
          RIDGECAST_SERVER, std::vector<std::string>{"--shared", redis->url(), "--trusted-proxy", "127.0.0.0/8", "--reconnect-url", "",
                                                     "--timeout", "600", "--log-level", "info"});
    const auto at = [](std::uint16_t p) { return "127.0.0.1:" + std::to_string(p); };
    bool ready = false;
    for (int attempt = 0; attempt < 5 && !ready; ++attempt) {  // somebody else may take the port before HAProxy does
      port = freePort();
      balancer = std::make_unique<Process>(std::vector<std::string>{"/usr/sbin/haproxy", "-db", "-f", RIDGECAST_HAPROXY},
                                           Environment{{"BIND", at(port)},
                                                       {"SERVER_A", at(servers[0]->port())},
                                                       {"SERVER_B", at(servers[1]->port())},
                                                       {"ADMIN", (folder / "admin").string()}});
      ready = await([&] { return !balancer->running() || get(port, "/readyz").starts_with("HTTP/1.1 200"); }) && balancer->running();
    }
    ASSERT_TRUE(ready) << balancer->output();
  }

  std::string url(const std::string& session) const {
    return "ws://127.0.0.1:" + std::to_string(port) + "?session=" + session + "&terrain=alpine&seed=1";
  }
  bool allAgree() {
    for (auto& c : clients)
      if (!c->agrees()) return false;
    return true;
  }
  void fly(const std::function<bool()>& until, std::chrono::milliseconds atMost = kTimeout) {
    for (const auto end = Clock::now() + atMost; Clock::now() < end && !until();) {
      for (std::size_t k = 0; k < clients.size(); ++k) {
        clients[k]->send(path->looped(std::chrono::duration<double>(Clock::now() - began).count() + 3 * static_cast<double>(k)));
        ASSERT_TRUE(clients[k]->take(0ms)) << clients[k]->failure();
      }
      std::this_thread::sleep_for(30ms);
    }
  }
  double cameras(std::size_t server) const { return figure(servers[server]->port(), "ridgecast_cameras"); }
  // A stream of session "race", and nothing more: it never says hello.
  void hold(int count) {
    for (int k = 0; k < count; ++k) {
      held.push_back(std::make_unique<SocketClient>(port));
      ASSERT_TRUE(held.back()->upgrade("/v1/stream?session=race&terrain=alpine&seed=1")) << held.back()->refusal();
    }
  }
  // Six clients in three sessions, flying.
  void depart() {
    for (int k = 0; k < 6; ++k) clients.push_back(std::make_unique<Traveller>(url("world-" + std::to_string(k % 3)), coarse()));
    path = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", clients[0]->line().world());
    fly([] { return false; }, 1500ms);
    fly([&] { return allAgree(); });
    ASSERT_TRUE(allAgree());
    ASSERT_EQ(cameras(0), 3);
    ASSERT_EQ(cameras(1), 3);
  }
  // All fly on at the other server (MEASURE=1: within ten seconds), holding what they held, and nobody was started again.
  void expectAllAt(std::size_t remaining) {
    const auto start = Clock::now();
    std::uint64_t again = 0;
    const auto arrived = [&] {
      again = 0;
      for (auto& c : clients) again += c->line().reconnections();
      return again >= 3 && allAgree();
    };
    fly(arrived);
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    EXPECT_TRUE(arrived());
    if (measures()) {
      EXPECT_LT(seconds, 10);
    }
    RecordProperty("milliseconds", static_cast<int>(seconds * 1e3));
    fly([] { return false; }, 1s);
    fly([&] { return allAgree(); });
    EXPECT_TRUE(allAgree());
    std::size_t resumed = 0;
    for (auto& c : clients) {
      EXPECT_EQ(c->mismatches(), 0u);
      resumed += c->resumed();
    }
    EXPECT_GT(resumed, 100u);
    EXPECT_TRUE(await([&] { return cameras(remaining) == 6; }));
  }

  ScratchFolder folder;
  std::optional<RedisServer> redis;
  std::unique_ptr<ServerProcess> servers[2];
  std::unique_ptr<Process> balancer;
  std::uint16_t port = 0;
  std::vector<std::unique_ptr<SocketClient>> held;
  std::vector<std::unique_ptr<Traveller>> clients;
  std::unique_ptr<PathCamera> path;
  const Clock::time_point began = Clock::now();
};

TEST_F(Balance, NewStreamsGoToTheServerWithTheFewest) {
  hold(10);
  EXPECT_TRUE(await([&] { return cameras(0) == 5 && cameras(1) == 5; })) << cameras(0) << " and " << cameras(1);
  servers[0]->process().signal(SIGUSR1);
  ASSERT_TRUE(await([&] { return get(servers[0]->port(), "/readyz").starts_with("HTTP/1.1 503"); }));
  hold(5);  // also those that come before HAProxy knows
  EXPECT_TRUE(await([&] { return cameras(0) == 0 && cameras(1) == 10; })) << cameras(0) << " and " << cameras(1);
  ASSERT_TRUE(await([&] { return balancer->output().find("Server servers/a is DOWN") != std::string::npos; }));
  held.clear();
  EXPECT_TRUE(await([&] { return cameras(1) == 0; }));
  hold(6);
  servers[0]->process().signal(SIGUSR2);
  ASSERT_TRUE(await([&] { return balancer->output().find("Server servers/a is UP") != std::string::npos; }));
  hold(6);
  EXPECT_TRUE(await([&] { return cameras(0) == 6 && cameras(1) == 6; })) << cameras(0) << " and " << cameras(1);
}

TEST_F(Balance, EverySessionIsReachedThroughAnyServer) {
  for (int k = 0; k < 4; ++k) {
    held.push_back(std::make_unique<SocketClient>(port));
    ASSERT_TRUE(held.back()->upgrade("/v1/stream?session=world-" + std::to_string(k) + "&terrain=alpine&seed=" + std::to_string(k)))
        << held.back()->refusal();
  }
  for (int k = 0; k < 4; ++k) {
    const std::string name = "world-" + std::to_string(k), heights = "/v1/heights?at=1,2&session=" + name;
    std::set<std::string> answers;
    for (auto& server : servers) {
      const std::string answer = get(server->port(), heights);
      EXPECT_THAT(answer, testing::StartsWith("HTTP/1.1 200")) << name;
      answers.insert(answer.substr(answer.find("{\"heights\"")));
      EXPECT_TRUE(await([&] { return get(server->port(), "/v1/sessions").find("\"" + name + "\"") != std::string::npos; })) << name;
    }
    EXPECT_EQ(answers.size(), 1u) << "both have the same world";
    EXPECT_THAT(get(port, "/v1/sessions/" + name + "/snapshot.json?x0=0&z0=0&x1=8&z1=8&error=5"), testing::StartsWith("HTTP/1.1 200"));
  }
  for (int k = 0; k < 4; ++k)
    EXPECT_THAT(get(port, "/v1/sessions/world-" + std::to_string(k), "DELETE"), testing::StartsWith("HTTP/1.1 20")) << k;  // 202: soon
  for (auto& server : servers) EXPECT_TRUE(await([&] { return get(server->port(), "/v1/sessions").find("world-") == std::string::npos; }));
}

// HAProxy adds a line of its own after the client's.
TEST_F(Balance, NobodyForgesHisAddress) {
  SocketClient client(port);
  client.send("GET /v1/sessions HTTP/1.1\r\nHost: elsewhere.example\r\nConnection: close\r\nX-Forwarded-For: 192.0.2.77\r\n\r\n");
  EXPECT_THAT(client.answer(), testing::StartsWith("HTTP/1.1 421"));
  const auto logged = [&](const std::string& what) {
    return servers[0]->process().output().find(what) != std::string::npos || servers[1]->process().output().find(what) != std::string::npos;
  };
  EXPECT_TRUE(await([&] { return logged("refused with 421"); }));
  EXPECT_FALSE(logged("192.0.2.77"));
}

TEST_F(Balance, DrainingMovesClientsToTheOther) {
  depart();
  servers[0]->process().signal(SIGUSR1);
  expectAllAt(1);
  EXPECT_TRUE(get(servers[0]->port(), "/readyz").starts_with("HTTP/1.1 503"));
  EXPECT_TRUE(await([&] { return cameras(0) == 0; }));
  EXPECT_EQ(servers[0]->stop(), 0);
}

TEST_F(Balance, EndingDoesTheSame) {
  depart();
  servers[0]->process().signal(SIGTERM);
  expectAllAt(1);
  EXPECT_EQ(servers[0]->process().wait(kTimeout), 0);
}

TEST_F(Balance, SoDoesAKill) {
  depart();
  servers[0]->process().signal(SIGKILL);
  expectAllAt(1);
}

}  // namespace
}  // namespace ridgecast
