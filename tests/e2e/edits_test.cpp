// Edits and a real server that is killed: whatever it acknowledged is there when it is back, once and in order, and its ground is that of a
// server that never fell. ROUNDS is the number of kills; a release is judged with 1,000.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "client/link/connection.h"
#include "client/query/ground.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/edits/json.h"
#include "tests/support/process.h"
#include "tests/support/random_edits.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using Json = nlohmann::json;
using lattice::Step;
using testing_support::ask;
using testing_support::ServerProcess;

// Again when it was too early.
std::string post(std::uint16_t port, const std::string& session, const std::string& operation, const std::string& key = "") {
  for (;;) {
    std::string answer =
        ask(port, "POST /v1/sessions/" + session + "/edits", operation, key.empty() ? "" : "Idempotency-Key: " + key + "\r\n");
    if (answer.find(" 429 ") == std::string::npos) return answer;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
}

Json bodyOf(const std::string& answer) {
  const auto at = answer.find("\r\n\r\n");
  return at == std::string::npos ? Json() : Json::parse(answer.substr(at + 4), nullptr, false);
}

std::vector<Json> editsOf(std::uint16_t port, const std::string& session) {
  std::vector<Json> all;
  for (;;) {
    const Json page = bodyOf(ask(port, "GET /v1/sessions/" + session + "/edits?limit=1000&since=" + std::to_string(all.size())));
    if (!page.is_object() || page["edits"].empty()) return all;
    for (const Json& edit : page["edits"]) all.push_back(edit);
  }
}

int rounds() {
  const char* const given = std::getenv("ROUNDS");
  return given ? std::atoi(given) : 6;
}

TEST(KilledServer, LosesNoEditThatItAcknowledged) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state", "--terrain", "alpine", "--seed", "3"};
  std::mt19937_64 random(17);
  std::map<std::string, std::uint64_t> acknowledged;  // key to number
  std::map<std::string, std::string> sent;            // key to operation
  int key = 0;
  for (int round = 0; round < rounds(); ++round) {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    const std::jthread killer([&server, wait = std::chrono::microseconds(random() % 400'000)] {
      std::this_thread::sleep_for(wait);
      kill(server.process().id(), SIGKILL);
    });
    for (int k = 0; k < 100; ++k) {
      const std::string name = "k" + std::to_string(key++);
      const bool undoes = !acknowledged.empty() && random() % 5 == 0;
      sent[name] = undoes ? edits::toJson({edits::Undo{1 + random() % acknowledged.size()}, 0})
                          : edits::toJson(testing_support::randomOperation(random, {0, 0}));
      const std::string answer = post(server.port(), "default", sent[name], name);
      if (answer.find(" 201 ") != std::string::npos) acknowledged[name] = bodyOf(answer)["number"];
      if (answer.empty()) break;
    }
  }
  ASSERT_GT(acknowledged.size(), static_cast<std::size_t>(rounds()));

  ServerProcess server(RIDGECAST_SERVER, arguments);
  const std::vector<Json> kept = editsOf(server.port(), "default");
  for (const auto& [name, number] : acknowledged) {
    ASSERT_LE(number, kept.size()) << name;
    // Asked again, it is the same edit.
    const std::string again = post(server.port(), "default", sent[name], name);
    EXPECT_EQ(bodyOf(again)["number"], number);
  }
  EXPECT_EQ(editsOf(server.port(), "default").size(), kept.size());  // none twice

  // The ground of one that never fell.
  const auto base = terrain::create("alpine", 3).value();
  edits::History history(base);
  for (const Json& edit : kept) {
    ASSERT_EQ(edit["number"], history.last() + 1);
    ASSERT_TRUE(history.add(edits::fromJson(edit["edit"].dump()).value()));
  }
  const edits::EditedTerrain terrain(base, history.layer());
  Json places = Json::array();
  std::vector<Step> x, z;
  for (double a = -100; a < 100; a += 1.7)
    for (double b = -100; b < 100; b += 1.7) {
      places.push_back({a, b});
      x.push_back(std::llround(a * 256));
      z.push_back(std::llround(b * 256));
    }
  const Json heights = bodyOf(ask(server.port(), "POST /v1/heights", Json{{"at", places}}.dump()))["heights"];
  ASSERT_EQ(heights.size(), x.size());
  std::vector<float> mine(x.size());
  terrain.heights(x, z, mine);
  for (std::size_t k = 0; k < mine.size(); ++k) ASSERT_EQ(heights[k].get<float>(), mine[k]);
}

// Its members gone, a session with edits ends, and is what it was when somebody comes again, or after a restart.
TEST(DurableSession, ComesBackWithItsWorldAndItsEdits) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state", "--session-idle", "1"};
  const std::string world = "GET /v1/heights?session=site&at=5,5", make = "&terrain=canyon&seed=9";
  float before = 0, after = 0;
  {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    before = bodyOf(ask(server.port(), world + make))["heights"][0];
    ASSERT_NE(ask(server.port(), "POST /v1/sessions/site/edits", R"({"op":"crater","x":5,"z":5,"radius":6,"depth":2})").find(" 201 "),
              std::string::npos);
    after = bodyOf(ask(server.port(), world))["heights"][0];
    EXPECT_NEAR(after, before - 2, 0.01);
    std::string sessions;
    for (int k = 0; k < 600 && (sessions.empty() || sessions.find("\"site\"") != std::string::npos); ++k) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
      sessions = ask(server.port(), "GET /v1/sessions");
    }
    ASSERT_EQ(sessions.find("\"site\""), std::string::npos);
    EXPECT_EQ(bodyOf(ask(server.port(), world))["heights"][0].get<float>(), after);
    EXPECT_NE(ask(server.port(), world + "&terrain=alpine&seed=9").find(" 409 "), std::string::npos);
    EXPECT_EQ(server.stop(), 0);
  }
  ServerProcess server(RIDGECAST_SERVER, arguments);
  EXPECT_EQ(bodyOf(ask(server.port(), world))["heights"][0].get<float>(), after);
  EXPECT_EQ(editsOf(server.port(), "site").size(), 1u);
}

TEST(DurableSession, KnowsKeysAndAuthorsAgain) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state"};
  const auto crater = [](int x) { return R"({"op":"crater","z":0,"radius":10,"depth":4,"x":)" + std::to_string(x) + "}"; };
  const std::string road = R"({"op":"road","line":[[0,0],[120,40],[300,-20]],"width":8})";
  const auto join = [](const ServerProcess& server, const std::string& name) {
    wire::Hello hello;
    hello.clientName = name;
    return link::Connection::open({"127.0.0.1", std::to_string(server.port()), "default"}, hello,
                                  {.reconnects = false, .timeout = testing_support::kTimeout})
        .value();
  };
  for (int round = 0; round < 2; ++round) {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    const auto ann = join(server, "ann"), liar = join(server, "address 127.0.0.1");
    const auto edit = [](link::Connection& by, const std::string& operation) { return by.edit({0, "k", operation}).get(); };
    EXPECT_EQ(edit(*ann, road).value().number, 1u);
    EXPECT_EQ(edit(*liar, crater(0)).value().number, 2u);
    EXPECT_EQ(bodyOf(post(server.port(), "default", crater(100), "k"))["number"], 3);
    EXPECT_EQ(edit(*ann, road).value().number, 1u);
    const auto another = edit(*ann, crater(0));
    ASSERT_FALSE(another);
    EXPECT_NE(another.error().message.find("another edit, number 1"), std::string::npos) << another.error().message;
    EXPECT_NE(post(server.port(), "default", crater(0), "k").find(" 422 "), std::string::npos);
    const auto kept = editsOf(server.port(), "default");
    ASSERT_EQ(kept.size(), 3u) << "round " << round;
    for (const Json& one : kept) EXPECT_EQ(one["author"], "address 127.0.0.1");
    EXPECT_EQ(kept[0]["name"], "ann");
    EXPECT_EQ(kept[1]["name"], "address 127.0.0.1");
    EXPECT_EQ(kept[2]["name"], "");
  }
}

TEST(DurableSession, CompactedEditsAreInTheAnswersOfThoseWhoComeLater) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state"};
  const auto crater = [](int x) { return R"({"op":"crater","z":0,"radius":10,"depth":4,"x":)" + std::to_string(x) + "}"; };
  {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    for (int x : {0, 100, 200}) EXPECT_EQ(bodyOf(post(server.port(), "default", crater(x)))["number"], 1 + x / 100);
  }
  ASSERT_EQ(testing_support::runProgram({RIDGECAST_SERVER, "edits", "compact", (folder / "state/default.edits").string()}).code, 0);
  ServerProcess server(RIDGECAST_SERVER, arguments);
  wire::Hello hello;
  hello.edits = true;
  const auto member = link::Connection::open({"127.0.0.1", std::to_string(server.port()), "default"}, hello,
                                             {.reconnects = false, .timeout = testing_support::kTimeout});
  ASSERT_TRUE(member);
  const query::Ground ground(**member, testing_support::kTimeout);
  EXPECT_EQ(ground.source(), query::Ground::Source::kServer) << "the edits are not told, so the ground cannot be computed here";
  const auto base = terrain::create("alpine", 1).value();
  const auto depthAt = [&](int x) { return base->height({x * 256, 0}) - ground.height(x, 0).value(); };
  EXPECT_NEAR(depthAt(100), 4, 0.1);
  EXPECT_EQ(bodyOf(post(server.port(), "default", crater(300)))["number"], 4);
  std::vector<wire::MadeEdit> heard;
  ASSERT_TRUE(testing_support::await([&] { return !(heard = (*member)->takeEdits().made).empty(); }));
  EXPECT_EQ(heard.front().number, 4u);
  EXPECT_NEAR(depthAt(300), 4, 0.1);
  EXPECT_FALSE((*member)->error());
}

TEST(DurableSession, WhatCannotBeKeptIsSaidAtTheStart) {
  const testing_support::ScratchFolder folder;
  {
    ServerProcess server(RIDGECAST_SERVER, {"--state", folder / "state"});
    ASSERT_NE(ask(server.port(), "POST /v1/sessions/default/edits", R"({"op":"crater","x":5,"z":5,"radius":6,"depth":2})").find(" 201 "),
              std::string::npos);
  }
  const auto refusal = [&](const std::vector<std::string>& arguments) -> std::string {
    try {
      ServerProcess server(RIDGECAST_SERVER, arguments);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(refusal({"--state", folder / "state", "--seed", "8"}).find("another world"), std::string::npos);
  EXPECT_NE(refusal({"--state", "/dev/null"}).find("not a folder"), std::string::npos);
  EXPECT_NE(refusal({"--state", folder / "state", "--watch"}).find("--watch"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast
