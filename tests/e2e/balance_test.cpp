// Two servers behind HAProxy, with the configuration that docker/ ships: sessions stay on their server, and one server that is drained or
// ended loses its clients to the other, with the right mesh, without any client being started again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <regex>
#include <string>
#include <thread>
#include <vector>

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
    for (auto& server : servers)
      server = std::make_unique<ServerProcess>(
          RIDGECAST_SERVER, std::vector<std::string>{"--trusted-proxy", "127.0.0.0/8", "--reconnect-url", "", "--log-level", "info"});
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
  // Of a server's default session.
  int members(std::size_t server) const {
    const std::string list = get(servers[server]->port(), "/v1/sessions");
    const auto at = list.find("\"members\":", list.find("\"default\""));
    return at == std::string::npos ? -1 : std::stoi(list.substr(at + 10));
  }
  // Six clients in three sessions, flying.
  void depart() {
    for (int k = 0; k < 6; ++k) clients.push_back(std::make_unique<Traveller>(url("world-" + std::to_string(k % 3)), coarse()));
    path = std::make_unique<PathCamera>(RIDGECAST_PATHS "/alpine.json", clients[0]->line().world());
    fly([] { return false; }, 1500ms);
    fly([&] { return allAgree(); });
    ASSERT_TRUE(allAgree());
    ASSERT_EQ(figure(servers[0]->port(), "ridgecast_cameras") + figure(servers[1]->port(), "ridgecast_cameras"), 6);
  }
  // The server that has clients: the one to be drained.
  std::size_t busier() {
    return figure(servers[0]->port(), "ridgecast_cameras") >= figure(servers[1]->port(), "ridgecast_cameras") ? 0 : 1;
  }
  // All fly on at the other server (MEASURE=1: within ten seconds), holding what they held, and nobody was started again.
  void expectAllAt(std::size_t remaining, double moved) {
    const auto start = Clock::now();
    std::uint64_t again = 0;
    const auto arrived = [&] {
      again = 0;
      for (auto& c : clients) again += c->line().reconnections();
      return again >= static_cast<std::uint64_t>(moved) && allAgree();
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
    EXPECT_TRUE(await([&] { return figure(servers[remaining]->port(), "ridgecast_cameras") == 6; }));
  }

  ScratchFolder folder;
  std::unique_ptr<ServerProcess> servers[2];
  std::unique_ptr<Process> balancer;
  std::uint16_t port = 0;
  std::vector<std::unique_ptr<Traveller>> clients;
  std::unique_ptr<PathCamera> path;
  const Clock::time_point began = Clock::now();
};

TEST_F(Balance, SessionsStayOnTheirServer) {
  // Each session is made by its first member: a second one on another server would make another.
  std::vector<std::unique_ptr<SocketClient>> held;
  for (int round = 0; round < 3; ++round)
    for (int k = 0; k < 20; ++k) {
      held.push_back(std::make_unique<SocketClient>(port));
      ASSERT_TRUE(held.back()->upgrade("/v1/stream?session=world-" + std::to_string(k) + "&terrain=alpine&seed=1"))
          << held.back()->refusal();
    }
  std::map<std::string, int> servedBy;
  for (auto& server : servers) {
    const std::string list = get(server->port(), "/v1/sessions");
    EXPECT_GT(figure(server->port(), "ridgecast_cameras"), 3) << "both are used";
    for (int k = 0; k < 20; ++k) {
      const std::string name = "\"world-" + std::to_string(k) + "\"";
      servedBy[name] += list.find(name) != std::string::npos;
    }
  }
  for (const auto& [name, count] : servedBy) EXPECT_EQ(count, 1) << name;
  // Whatever names a session reaches it: in the query, in the path, or not at all for the default one.
  for (int k = 0; k < 20; ++k) {
    const std::string name = "world-" + std::to_string(k);
    EXPECT_THAT(get(port, "/v1/heights?at=1,2&session=" + name), testing::StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(get(port, "/v1/sessions?session=" + name), testing::HasSubstr("\"" + name + "\"")) << "those of its server";
    EXPECT_THAT(get(port, "/v1/sessions/" + name + "/snapshot.json?x0=0&z0=0&x1=8&z1=8&error=5"), testing::StartsWith("HTTP/1.1 200"));
  }
  SocketClient nameless(port), named(port);
  ASSERT_TRUE(nameless.upgrade("/v1/stream") && named.upgrade("/v1/stream?session=default"));
  EXPECT_TRUE(await([&] { return members(0) + members(1) == 2; })) << "they enter a moment after the upgrade";
  EXPECT_NE(members(0), 1) << "one is elsewhere";
}

TEST_F(Balance, EndingASessionReachesItsServer) {
  std::vector<std::unique_ptr<SocketClient>> held;
  for (int k = 0; k < 10; ++k) {
    held.push_back(std::make_unique<SocketClient>(port));
    ASSERT_TRUE(held.back()->upgrade("/v1/stream?session=world-" + std::to_string(k) + "&terrain=alpine&seed=1")) << held.back()->refusal();
  }
  for (int k = 0; k < 10; ++k)
    EXPECT_THAT(get(port, "/v1/sessions/world-" + std::to_string(k) + (k % 2 ? "?x=1" : ""), "DELETE"), testing::StartsWith("HTTP/1.1 200"))
        << k;
  for (auto& server : servers) EXPECT_EQ(get(server->port(), "/v1/sessions").find("world-"), std::string::npos);
}

// There is no ingress here: its pattern alone is tried.
TEST(Ingress, FindsASessionsNameInThePath) {
  std::ifstream file(RIDGECAST_INGRESS);
  const std::string yaml{std::istreambuf_iterator<char>(file), {}}, before = "if ($uri ~ \"";
  const auto at = yaml.find(before);
  ASSERT_NE(at, std::string::npos);
  const std::regex pattern(yaml.substr(at + before.size(), yaml.find('"', at + before.size()) - at - before.size()));
  for (const char* path : {"/v1/sessions/race", "/v1/sessions/race/", "/v1/sessions/race/members/7", "/v1/sessions/race/snapshot.glb"}) {
    std::cmatch found;
    ASSERT_TRUE(std::regex_search(path, found, pattern)) << path;
    EXPECT_EQ(found[1], "race") << path;
  }
  for (const char* path : {"/v1/sessions", "/v1/sessions/", "/v1/heights", "/v1/stream"})
    EXPECT_FALSE(std::regex_search(path, pattern)) << path;
}

TEST_F(Balance, ANameIsTheSameHoweverItIsWritten) {
  std::vector<std::unique_ptr<SocketClient>> held;
  for (const char* name : {"race", "%72ace", "r%61ce", "%72%61%63%65", "track", "%74rack"}) {
    held.push_back(std::make_unique<SocketClient>(port));
    ASSERT_TRUE(held.back()->upgrade("/v1/stream?terrain=alpine&seed=1&session=" + std::string(name))) << held.back()->refusal();
  }
  for (const char* name : {"", "&session=", "&session=default", "&session=%64efault"}) {
    held.push_back(std::make_unique<SocketClient>(port));
    ASSERT_TRUE(held.back()->upgrade("/v1/stream?x=1" + std::string(name))) << held.back()->refusal();
  }
  for (const char* name : {"\"race\"", "\"track\""}) {
    int servers_ = 0;
    for (auto& server : servers) servers_ += get(server->port(), "/v1/sessions").find(name) != std::string::npos;
    EXPECT_EQ(servers_, 1) << name;
  }
  EXPECT_TRUE(await([&] { return members(0) + members(1) == 4; }));
  EXPECT_THAT(members(0), testing::AnyOf(0, 4));
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
  const std::size_t leaving = busier();
  const double moved = figure(servers[leaving]->port(), "ridgecast_cameras");
  servers[leaving]->process().signal(SIGUSR1);
  expectAllAt(1 - leaving, moved);
  EXPECT_TRUE(get(servers[leaving]->port(), "/readyz").starts_with("HTTP/1.1 503"));
  EXPECT_TRUE(await([&] { return figure(servers[leaving]->port(), "ridgecast_cameras") == 0; }));
  EXPECT_EQ(servers[leaving]->stop(), 0);
}

TEST_F(Balance, EndingDoesTheSame) {
  depart();
  const std::size_t leaving = busier();
  const double moved = figure(servers[leaving]->port(), "ridgecast_cameras");
  servers[leaving]->process().signal(SIGTERM);
  expectAllAt(1 - leaving, moved);
  EXPECT_EQ(servers[leaving]->process().wait(kTimeout), 0);
}

}  // namespace
}  // namespace ridgecast
