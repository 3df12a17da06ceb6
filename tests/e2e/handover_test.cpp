// Two servers on one folder of edits: each session is one's alone, the next has what the last acknowledged, and nothing is lost or made
// twice whichever of them is killed when. ROUNDS says how often, 1000 before a release.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "tests/support/process.h"
#include "tests/support/sanitized.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using namespace testing_support;
using testing::HasSubstr;

std::string crater(int x) { return R"({"op":"crater","z":0,"radius":5,"depth":1,"x":)" + std::to_string(x) + "}"; }
std::string edit(std::uint16_t port, const std::string& session, int x, const std::string& key = "") {
  return ask(port, "POST /v1/sessions/" + session + "/edits", crater(x), key.empty() ? "" : "Idempotency-Key: " + key + "\r\n");
}
std::string enter(std::uint16_t port, const std::string& session) {
  return ask(port, "GET /v1/heights?at=5,5&session=" + session + (session == "default" ? "" : "&terrain=canyon&seed=7"));
}
// Of the edit that an answer acknowledges; 0: it does not.
std::uint64_t numberIn(const std::string& answer) {
  const auto at = answer.find("{\"number\": ");
  return answer.find(" 201 ") == answer.npos || at == answer.npos ? 0 : std::stoull(answer.substr(at + 11));
}

TEST(Handover, TheNextServerHasWhatTheLastAcknowledged) {
  const ScratchFolder folder;
  const std::vector<std::string> settings{"--state", (folder / "state").string(), "--drain", "60"};
  ServerProcess first(RIDGECAST_SERVER, settings);
  ServerProcess second(RIDGECAST_SERVER, settings);
  EXPECT_THAT(ask(second.port(), "GET /readyz"), HasSubstr(" 200 "));
  for (const char* const session : {"default", "site"}) {
    EXPECT_THAT(enter(first.port(), session), HasSubstr(" 200 "));
    for (int x = 1; x <= 2; ++x) EXPECT_EQ(numberIn(edit(first.port(), session, x)), static_cast<std::uint64_t>(x));
    const std::string path = std::string("/v1/sessions/") + session;
    for (const std::string& refused :
         {enter(second.port(), session), edit(second.port(), session, 9), ask(second.port(), "GET " + path + "/edits"),
          ask(second.port(), "GET " + path + "/heights/9/256/256.png?at=8,47"), ask(second.port(), "GET " + path + "/snapshot.glb"),
          ask(second.port(), "DELETE " + path)}) {
      EXPECT_THAT(refused, HasSubstr(" 503 "));
      EXPECT_THAT(refused, HasSubstr("Retry-After: 1"));
    }
    EXPECT_THAT(edit(second.port(), "nowhere", 9), HasSubstr(" 404 "));
  }
  SocketClient stays(first.port());  // so that the first waits
  ASSERT_TRUE(stays.upgrade());
  ASSERT_TRUE(stays.message(wire::encode(wire::ClientMessage(wire::Hello()))));
  ASSERT_TRUE(stays.receive());
  first.process().signal(SIGTERM);
  for (const char* const session : {"default", "site"}) {
    ASSERT_TRUE(await([&] { return enter(second.port(), session).find(" 200 ") != std::string::npos; }));
    EXPECT_TRUE(first.process().running());
    EXPECT_EQ(numberIn(edit(second.port(), session, 3)), 3u);
    const std::string all = ask(second.port(), std::string("GET /v1/sessions/") + session + "/edits");
    for (int x = 1; x <= 3; ++x) EXPECT_THAT(all, HasSubstr("\"x\":" + std::to_string(x) + ".0"));
  }
}

class TwoServers {
 public:
  TwoServers() {
    for (auto& one : servers_) one = std::make_unique<ServerProcess>(RIDGECAST_SERVER, settings());
  }
  std::uint16_t port(std::size_t which) {
    const std::lock_guard lock(mutex_);
    return servers_[which]->port();
  }
  void replace(std::size_t which, int signal) {
    servers_[which]->process().signal(signal);
    servers_[which]->process().wait(kTimeout);
    auto next = std::make_unique<ServerProcess>(RIDGECAST_SERVER, settings());
    const std::lock_guard lock(mutex_);
    servers_[which] = std::move(next);
  }
  void kill() {
    for (auto& one : servers_) {
      one->process().signal(SIGKILL);
      one->process().wait(kTimeout);
    }
  }
  std::string log(const std::string& session) const { return (folder_ / "state").string() + "/" + session + ".edits"; }

 private:
  std::vector<std::string> settings() const { return {"--state", (folder_ / "state").string(), "--drain", "1", "--threads", "1"}; }
  const ScratchFolder folder_;
  std::mutex mutex_;
  std::array<std::unique_ptr<ServerProcess>, 2> servers_;
};

TEST(Handover, NothingIsLostOrMadeTwiceWhoeverIsKilled) {
  const char* const wanted = std::getenv("ROUNDS");
  const int rounds = wanted ? std::atoi(wanted) : testing_support::rounds(16);
  const std::array<std::string, 3> sessions{"default", "a", "b"};
  TwoServers servers;
  std::atomic<bool> isOver{false};
  std::mutex mutex;
  std::map<std::string, std::map<std::string, std::uint64_t>> acknowledged;  // by session and key
  const auto note = [&](const std::string& session, const std::string& key, std::uint64_t number) {
    const std::lock_guard lock(mutex);
    acknowledged[session][key] = number;
  };
  std::vector<std::jthread> editors;
  for (unsigned n = 0; n < 3; ++n)  // over HTTP; what was not answered is sent again with its key, here or there
    editors.emplace_back([&, n] {
      std::mt19937 random(n);
      for (int k = 0; !isOver; ++k) {
        const std::string& session = sessions[random() % 3];
        const std::string key = "h" + std::to_string(n) + "-" + std::to_string(k);
        for (int attempt = 0; attempt < 50 && !isOver; ++attempt) {
          const std::uint16_t port = servers.port(random() % 2);
          if (const std::uint64_t number = numberIn(edit(port, session, k, key))) {
            note(session, key, number);
            break;
          }
          enter(port, session);
          std::this_thread::sleep_for(1ms * (random() % 10));
        }
      }
    });
  editors.emplace_back([&] {  // over streams
    std::mt19937 random(99);
    for (int k = 0; !isOver;) {
      core::Url url{"127.0.0.1", std::to_string(servers.port(random() % 2)), "default"};
      wire::Hello hello;
      hello.clientName = "member";
      const auto opened = link::Connection::open(url, hello, {.reconnects = false, .timeout = kTimeout});
      if (!opened) {
        std::this_thread::sleep_for(10ms);
        continue;
      }
      for (;; ++k) {
        const std::string key = "s" + std::to_string(k);
        const auto number = (*opened)->edit({0, key, crater(k)}).get();
        if (number) note("default", key, number->number);
        if (!number || isOver) break;
      }
    }
  });
  std::mt19937 random(7);
  for (int round = 0; round < rounds; ++round) {
    std::this_thread::sleep_for(1ms * (random() % 300));
    servers.replace(random() % 2, random() % 3 == 0 ? SIGTERM : SIGKILL);
  }
  std::this_thread::sleep_for(300ms);
  isOver = true;
  editors.clear();
  servers.kill();
  for (const std::string& session : sessions) {
    const auto lines = runProgram({RIDGECAST_SERVER, "edits", "export", servers.log(session)});
    ASSERT_EQ(lines.code, 0) << lines.output;
    std::map<std::string, std::uint64_t> kept;
    std::istringstream in(lines.output);
    std::uint64_t last = 0;
    for (std::string line; std::getline(in, line);) {
      const auto json = nlohmann::json::parse(line);
      EXPECT_EQ(json["number"], ++last);
      const std::string whole = json["key"];
      EXPECT_TRUE(kept.emplace(whole.substr(whole.rfind('\n') + 1), last).second) << "made twice: " << whole;
    }
    EXPECT_GT(acknowledged[session].size(), 0u);
    for (const auto& [key, number] : acknowledged[session]) {
      ASSERT_TRUE(kept.contains(key)) << "lost: " << key << ", acknowledged as " << number << " of " << session;
      EXPECT_EQ(kept[key], number) << key;
    }
    std::printf("%s: %zu acknowledged, %zu kept, over %d rounds\n", session.c_str(), acknowledged[session].size(), kept.size(), rounds);
    EXPECT_EQ(runProgram({RIDGECAST_SERVER, "edits", "verify", servers.log(session)}).code, 0);
  }
}

}  // namespace
}  // namespace ridgecast
