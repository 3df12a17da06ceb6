// Servers with one Redis between them: a session is one world wherever its members are, and what is asked of one server holds on all.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

int statusOf(const std::string& answer) { return answer.size() < 12 ? 0 : std::stoi(answer.substr(9)); }
std::string bodyOf(const std::string& answer) {
  const auto at = answer.find("\r\n\r\n");
  return at == std::string::npos ? "" : answer.substr(at + 4);
}

class SharedWorlds : public testing::Test {
 protected:
  void SetUp() override {
    if (!RedisServer::exists()) GTEST_SKIP() << "redis-server is not installed";
    redis.emplace();
  }
  std::unique_ptr<ServerProcess> start(std::vector<std::string> arguments = {}) const {
    arguments.insert(arguments.end(), {"--shared", redis->url(), "--timeout", "600"});
    return std::make_unique<ServerProcess>(RIDGECAST_SERVER, arguments);
  }
  // By name, as this server lists them.
  static std::map<std::string, json> list(const ServerProcess& server) {
    std::map<std::string, json> sessions;
    const json all = json::parse(bodyOf(ask(server.port(), "GET /v1/sessions")), nullptr, false);
    if (all.is_object())
      for (const json& session : all["sessions"]) sessions[session["name"]] = session;
    return sessions;
  }
  static std::string heights(const ServerProcess& server, const std::string& session) {
    return ask(server.port(), "GET /v1/heights?session=" + session + "&at=10,20&at=-3000,450.5");
  }

  ScratchFolder folder;
  std::optional<RedisServer> redis;
};

TEST_F(SharedWorlds, ASessionMadeOnOneIsJoinedListedAndEndedOnAnother) {
  const auto a = start({"--url", "https://a.example"}), b = start();
  const std::string made = heights(*a, "alps&terrain=alpine&seed=7");
  ASSERT_EQ(statusOf(made), 200) << made;
  EXPECT_EQ(bodyOf(heights(*b, "alps")), bodyOf(made));
  EXPECT_NE(bodyOf(heights(*b, "other&terrain=alpine&seed=8")), bodyOf(made));
  EXPECT_EQ(statusOf(heights(*b, "alps&terrain=alpine&seed=8")), 409);
  EXPECT_EQ(list(*a)["alps"]["content_hash"], list(*b)["alps"]["content_hash"]);

  SocketClient first(a->port()), second(b->port()), third(b->port());
  for (auto* client : {&first, &second, &third}) ASSERT_TRUE(client->upgrade("/v1/stream?session=alps")) << client->refusal();
  for (const auto* server : {a.get(), b.get()}) {
    EXPECT_TRUE(await([&] { return list(*server)["alps"]["members"] == 3; })) << list(*server)["alps"];
    EXPECT_TRUE(await([&] { return list(*server)["other"]["servers"].size() == 1; }));
  }
  const json all = json::parse(bodyOf(ask(b->port(), "GET /v1/sessions")));
  EXPECT_THAT(all["servers"].dump(), HasSubstr("https://a.example"));

  EXPECT_EQ(statusOf(ask(b->port(), "DELETE /v1/sessions/alps")), 202);
  for (auto* client : {&first, &second, &third}) EXPECT_EQ(client->awaitClose(), 1008);
  EXPECT_TRUE(await([&] { return !list(*a).contains("alps") && !list(*b).contains("alps"); }));
  EXPECT_EQ(statusOf(heights(*a, "alps&terrain=alpine&seed=9")), 200) << "its name is free";
  EXPECT_EQ(bodyOf(heights(*b, "alps")), bodyOf(heights(*a, "alps")));
}

TEST_F(SharedWorlds, MembersCountAndAreSentAwayOverAllServers) {
  const std::vector<std::string> two{"--max-members", "2"};
  const auto a = start(two), b = start(two);
  SocketClient first(a->port()), second(b->port());
  ASSERT_TRUE(first.upgrade() && second.upgrade());
  EXPECT_TRUE(await([&] { return list(*a)["default"]["members"] == 2 && list(*b)["default"]["members"] == 2; }));
  SocketClient third(b->port());
  ASSERT_TRUE(third.upgrade());
  EXPECT_EQ(third.awaitClose(), 1008) << "full";
  const auto numbers = json::parse(bodyOf(ask(b->port(), "GET /v1/sessions")))["servers"];
  std::set<std::uint64_t> servers;
  for (const json& server : numbers) servers.insert(server["number"].get<std::uint64_t>());
  ASSERT_EQ(servers.size(), 2u);
  // The first camera of each server, by the other one.
  for (const std::uint64_t server : servers) {
    const std::string line = "DELETE /v1/sessions/default/members/" + std::to_string((server << 32) + 1);
    EXPECT_TRUE(statusOf(ask(a->port(), line)) == 202 || statusOf(ask(b->port(), line)) == 202);
  }
  EXPECT_EQ(first.awaitClose(), 1008);
  EXPECT_EQ(second.awaitClose(), 1008);
  EXPECT_EQ(statusOf(ask(b->port(), "DELETE /v1/sessions/default/members/17")), 404);
}

TEST_F(SharedWorlds, ATokenWithdrawnOnOneServerEndsItsStreamsOnAll) {
  const std::filesystem::path files[] = {folder / "a", folder / "b"};
  const auto made = runProgram({RIDGECAST_SERVER, "token", "--token-file", files[0], "--holder", "lab"});
  ASSERT_EQ(made.code, 0) << made.output;
  const std::string token = made.output.substr(made.output.find("rc_"), 46);
  ASSERT_EQ(runProgram({RIDGECAST_SERVER, "token", "--token-file", files[0], "--holder", "other"}).code, 0);
  std::filesystem::copy(files[0], files[1]);
  const auto a = start({"--token-file", files[0], "--log-level", "info"}), b = start({"--token-file", files[1], "--log-level", "info"});
  const std::string bearer = "Authorization: Bearer " + token + "\r\n";
  SocketClient stream(b->port());
  ASSERT_TRUE(stream.upgrade("/v1/stream?session=default", bearer)) << stream.refusal();
  std::string lines = readText(files[0]);
  std::ofstream(files[0]) << lines.substr(lines.find("other"));
  a->process().signal(SIGHUP);
  EXPECT_EQ(stream.awaitClose(), 1008);
  EXPECT_EQ(statusOf(ask(b->port(), "GET /v1/terrains", "", bearer)), 401);
  EXPECT_THAT(a->process().output(), HasSubstr("...) was withdrawn: it is no longer in '" + files[0].string() + "'"));
  EXPECT_THAT(b->process().output(), AllOf(HasSubstr("the token of lab (sha256:"), HasSubstr("...) was withdrawn: at another server")));
  b->process().signal(SIGHUP);
  EXPECT_TRUE(await([&] { return statusOf(ask(b->port(), "GET /v1/terrains", "", bearer)) == 200; })) << "its own file has it still";
}

TEST_F(SharedWorlds, AServerWithAnotherWorldSaysSo) {
  const auto a = start();
  for (const std::vector<std::string>& other : {std::vector<std::string>{"--seed", "2"}, {"--terrain", "canyon"}}) {
    std::vector<std::string> command{RIDGECAST_SERVER, "--port", "0", "--shared", redis->url()};
    command.insert(command.end(), other.begin(), other.end());
    const auto ended = runProgram(command);
    EXPECT_EQ(ended.code, 2);
    EXPECT_THAT(ended.output, AllOf(HasSubstr("'default' is another world on this server"), HasSubstr("seed 1"), HasSubstr("start all")));
  }
  const auto watching = runProgram({RIDGECAST_SERVER, "--port", "0", "--shared", redis->url(), "--watch"});
  EXPECT_EQ(watching.code, 2);
  EXPECT_THAT(watching.output, HasSubstr("--watch"));
}

TEST_F(SharedWorlds, ATerrainFileThatDiffersIsRefused) {
  for (const auto& [name, height] : {std::pair{"a", "7"}, {"b", "8"}}) {
    std::filesystem::create_directory(folder / name);
    std::ofstream(folder / name / "plain.glsl")
        << "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return " << height << ".0; }\n"
        << "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }\n";
  }
  const auto a = start({"--terrain-dir", folder / "a"}), b = start({"--terrain-dir", folder / "b"});
  EXPECT_EQ(statusOf(heights(*a, "plain&terrain=plain")), 200);
  const std::string refusal = heights(*b, "plain");
  EXPECT_EQ(statusOf(refusal), 503);
  EXPECT_THAT(refusal, AllOf(HasSubstr("other ground on the other servers"), HasSubstr("give all servers the same terrain files")));
}

// The first member of each session gives its seed, the others only its terrain: whoever makes a second world of that name makes another.
TEST_F(SharedWorlds, TenSessionsStayOneWorldEachWhileServersComeAndGo) {
  constexpr int kSessions = 10;
  constexpr int kRounds = 12, kJoins = 15;
  std::map<std::string, std::string> truth;
  const ServerProcess alone(RIDGECAST_SERVER);
  for (int k = 0; k < kSessions; ++k) {
    const std::string name = "world" + std::to_string(k);
    truth[name] = bodyOf(heights(alone, name + "&terrain=alpine&seed=" + std::to_string(k + 2)));
    ASSERT_THAT(truth[name], HasSubstr("heights"));
  }
  std::mt19937 random(1);
  std::vector<std::unique_ptr<ServerProcess>> servers;
  for (int k = 0; k < 3; ++k) servers.push_back(start());
  const auto any = [&]() -> ServerProcess& { return *servers[random() % servers.size()]; };
  for (const auto& [name, body] : truth)
    ASSERT_EQ(bodyOf(heights(any(), name + "&terrain=alpine&seed=" + std::to_string(std::stoi(name.substr(5)) + 2))), body);
  int joins = 0, splits = 0, refusals = 0;
  for (int round = 0; round < kRounds; ++round) {
    if (round % 2 == 0) {
      const std::size_t which = random() % servers.size();
      if (round % 4 == 0)
        servers[which]->process().signal(SIGKILL);
      else
        servers[which]->stop();
      servers.erase(servers.begin() + static_cast<std::ptrdiff_t>(which));
    } else {
      servers.push_back(start());
    }
    for (int k = 0; k < kJoins; ++k, ++joins) {
      const std::string name = "world" + std::to_string(random() % kSessions);
      const std::string answer = heights(any(), name + "&terrain=alpine");
      refusals += statusOf(answer) != 200;
      splits += statusOf(answer) == 200 && bodyOf(answer) != truth[name];
    }
  }
  EXPECT_EQ(splits, 0) << "of " << joins << " joins";
  EXPECT_EQ(refusals, 0);
  std::map<std::string, std::set<std::string>> hashes;
  for (const auto& server : servers)
    for (const auto& [name, session] : list(*server)) hashes[name].insert(session["content_hash"]);
  for (const auto& [name, all] : hashes) EXPECT_EQ(all.size(), 1u) << name;
}

}  // namespace
}  // namespace ridgecast
