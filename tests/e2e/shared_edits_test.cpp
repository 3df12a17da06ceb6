// Edits of one session on two servers with a real Redis: one order, also while each of the three is killed.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;

class SharedEdits : public testing::Test {
 protected:
  void SetUp() override {
    if (!RedisServer::exists()) GTEST_SKIP() << "there is no redis-server";
    redis = std::make_unique<RedisServer>();
    for (std::size_t k = 0; k < 2; ++k) start(k);
  }
  void start(std::size_t k) {
    servers[k] = std::make_unique<ServerProcess>(
        RIDGECAST_SERVER, std::vector<std::string>{"--shared", redis->url(), "--state", (folder / std::to_string(k)).string()});
  }
  void kill(std::size_t k) {
    servers[k]->process().signal(SIGKILL);
    ASSERT_TRUE(servers[k]->process().wait(kTimeout));
  }
  std::string say(std::size_t k, const std::string& line, const std::string& body = "", const std::string& headers = "") {
    return ask(servers[k]->port(), line, body, headers);
  }
  // As a client does: again with its key, by either server, until it has a number.
  void make(int edit) {
    const std::string crater = "{\"op\": \"crater\", \"x\": " + std::to_string(20 * edit) +
                               ", \"z\": 0, \"radius\": 5, \"depth\": " + std::to_string(1 + edit % 3) + "}";
    const std::string headers = "Idempotency-Key: edit" + std::to_string(edit) + "\r\n";
    std::string answer;
    std::size_t at = static_cast<std::size_t>(edit) % 2;
    ASSERT_TRUE(await([&] {
      answer = say(at, "POST /v1/sessions/default/edits", crater, headers);
      at = 1 - at;
      return answer.find(" 201 ") != answer.npos;
    })) << answer;
    const std::string field = "\"number\": ";
    made[edit] = std::stoull(answer.substr(answer.find(field) + field.size()));
  }
  std::string bodyOf(const std::string& answer) { return answer.substr(std::min(answer.size(), answer.find("\r\n\r\n"))); }

  // At both, once they have the last edit: the same ground, and each edit where it was acknowledged, once.
  void expectOneOrder() {
    std::uint64_t last = 0;
    for (const auto& [edit, number] : made) last = std::max(last, number);
    std::string heights = "GET /v1/heights?";
    for (const auto& [edit, number] : made) heights += "at=" + std::to_string(20 * edit) + ",1&";
    heights.pop_back();
    std::string bodies[2], lists[2];
    for (std::size_t k = 0; k < 2; ++k) {
      std::string answer;
      ASSERT_TRUE(await([&] {
        answer = say(k, heights, "", "Ridgecast-Edit: " + std::to_string(last) + "\r\n");
        return answer.find(" 200 ") != answer.npos;
      })) << answer;
      bodies[k] = bodyOf(answer);
      lists[k] = bodyOf(say(k, "GET /v1/sessions/default/edits?limit=1000"));
    }
    EXPECT_EQ(bodies[0], bodies[1]);
    EXPECT_EQ(lists[0], lists[1]);
    EXPECT_EQ(made.size(), last) << "an edit was made twice";
    for (const auto& [edit, number] : made) {
      const std::size_t at = lists[0].find("\"number\": " + std::to_string(number) + ",");
      ASSERT_NE(at, std::string::npos) << number;
      EXPECT_THAT(lists[0].substr(at, lists[0].find('\n', at) - at), HasSubstr("\"x\":" + std::to_string(20 * edit))) << number;
    }
  }

  const ScratchFolder folder;
  std::unique_ptr<RedisServer> redis;
  std::unique_ptr<ServerProcess> servers[2];
  std::map<int, std::uint64_t> made;  // edit -> number
};

TEST_F(SharedEdits, HaveOneOrderWhateverIsKilled) {
  int edit = 0;
  const auto some = [&] {
    for (const int end = edit + 6; edit < end; ++edit) make(edit);
  };
  some();
  for (std::size_t k = 0; k < 2; ++k) {
    kill(k);
    some();  // by the other
    start(k);
    some();
  }
  redis->kill();
  EXPECT_TRUE(await([&] {
    const std::string answer = say(0, "POST /v1/sessions/default/edits", "{\"op\": \"undo\", \"edit\": 1}", "Idempotency-Key: no\r\n");
    return answer.find(" 429 ") != answer.npos;
  })) << "refused for now";
  EXPECT_THAT(say(0, "GET /v1/heights?at=0,0"), HasSubstr(" 200 ")) << "the ground stays";
  redis->start();
  some();
  expectOneOrder();
  for (std::size_t k = 0; k < 2; ++k) kill(k);
  for (std::size_t k = 0; k < 2; ++k) start(k);
  some();
  expectOneOrder();
}

// Otherwise who comes first waits until it has read them.
TEST_F(SharedEdits, AreReadBeforeAServerThatComesBackIsReady) {
  const auto makeOn = [&](std::size_t k, const std::string& session) {
    EXPECT_THAT(say(k, "POST /v1/sessions/" + session + "/edits", "{\"op\": \"crater\", \"x\": 0, \"z\": 0, \"radius\": 5, \"depth\": 1}"),
                HasSubstr(" 201 "));
  };
  for (std::size_t k = 0; k < 2; ++k) EXPECT_THAT(say(k, "GET /v1/heights?session=w&terrain=canyon&at=0,0"), HasSubstr(" 200 "));
  makeOn(1, "w");
  const auto serversOfW = [&] {
    const auto listed = nlohmann::json::parse(bodyOf(say(1, "GET /v1/sessions")));
    for (const auto& session : listed["sessions"])
      if (session["name"] == "w") return session["servers"].get<std::vector<int>>();
    return std::vector<int>();
  };
  ASSERT_TRUE(await([&] { return serversOfW().size() == 2; }));  // each second they tell
  servers[1].reset();
  for (int k = 0; k < 20; ++k)
    for (const char* session : {"w", "default"}) makeOn(0, session);
  start(1);
  ASSERT_TRUE(await([&] { return bodyOf(say(1, "GET /readyz")) == "\r\n\r\nready\n"; }));
  EXPECT_THAT(serversOfW(), testing::Contains(3)) << "though nobody has asked it";
  EXPECT_THAT(say(1, "GET /v1/sessions/w/edits?since=20&limit=1"), HasSubstr("\"last\": 21"));
  EXPECT_THAT(say(1, "GET /v1/sessions/default/edits?since=19&limit=1"), HasSubstr("\"last\": 20"));
}

TEST_F(SharedEdits, NeedAFolderForEachServer) {
  const Finished second = runProgram({RIDGECAST_SERVER, "--port", "0", "--shared", redis->url(), "--state", (folder / "0").string()});
  EXPECT_NE(second.code, 0);
  EXPECT_THAT(second.output, HasSubstr("is another server's; with --shared each server has a folder of its own"));
}

// A browser that a balancer sends elsewhere has the files still.
TEST_F(SharedEdits, GiveEqualFilesEqualTags) {
  make(0);
  for (const std::string file :
       {"heights/14/8192/8192.png?at=0,0", "3dtiles/tileset.json", "snapshot.glb?x0=0&z0=0&x1=100&z1=100&error=2"}) {
    SCOPED_TRACE(file);
    const std::string line = "GET /v1/sessions/default/" + file;
    const auto awaited = [&] { return "Ridgecast-Edit: " + std::to_string(made.size()) + "\r\n"; };
    const auto tagOf = [](const std::string& answer) {
      const auto at = answer.find("\r\nETag: ");
      return at == answer.npos ? "" : answer.substr(at + 8, answer.find("\r\n", at + 2) - at - 8);
    };
    const std::string tag = tagOf(say(0, line, "", awaited()));
    EXPECT_FALSE(tag.empty());
    EXPECT_THAT(say(1, line, "", awaited() + "If-None-Match: " + tag + "\r\n"), HasSubstr(" 304 "));
    make(static_cast<int>(made.size()));
    EXPECT_NE(tagOf(say(1, line, "", awaited())), tag) << "another ground";
  }
}

TEST_F(SharedEdits, AreAwaited) {
  make(0);
  const std::string late = say(1, "GET /v1/heights?at=0,0", "", "Ridgecast-Edit: 7\r\n");
  EXPECT_THAT(late, HasSubstr(" 503 "));
  EXPECT_THAT(late, HasSubstr("Retry-After: 1"));
  EXPECT_THAT(late, HasSubstr("Edit 7 has not reached this server"));
}

}  // namespace
}  // namespace ridgecast
