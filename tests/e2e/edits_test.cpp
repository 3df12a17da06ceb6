// Sessions that a real server keeps in a folder: they come back with their worlds and edits.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "client/link/connection.h"
#include "client/query/ground.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using Json = nlohmann::json;
using testing_support::ask;
using testing_support::ServerProcess;

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

// As the clients of a server that ended come to another one.
TEST(DurableSession, AllMembersOfOneAddressMayComeBackAtOnce) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state"};
  const std::string world = "GET /v1/heights?session=site&at=5,5";
  {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    ask(server.port(), world + "&terrain=canyon");
    for (int k = 0; k < 50; ++k)
      ASSERT_NE(
          ask(server.port(), "POST /v1/sessions/site/edits", R"({"op":"smooth","z":5,"radius":40,"x":)" + std::to_string(60 * k) + "}")
              .find(" 201 "),
          std::string::npos);
    server.process().signal(SIGKILL);
  }
  ServerProcess server(RIDGECAST_SERVER, arguments);
  std::vector<std::string> answers(80);
  {
    std::vector<std::jthread> members;
    for (std::string& answer : answers) members.emplace_back([&] { answer = ask(server.port(), world); });
  }
  for (const std::string& answer : answers) EXPECT_EQ(answer.substr(0, 12), "HTTP/1.1 200") << answer;
}

TEST(DurableSession, CompactedEditsAreInTheAnswersOfThoseWhoComeLater) {
  const testing_support::ScratchFolder folder;
  const std::vector<std::string> arguments{"--state", folder / "state"};
  const auto crater = [](int x) { return R"({"op":"crater","z":0,"radius":10,"depth":4,"x":)" + std::to_string(x) + "}"; };
  {
    ServerProcess server(RIDGECAST_SERVER, arguments);
    for (int x : {0, 100, 200}) EXPECT_EQ(bodyOf(ask(server.port(), "POST /v1/sessions/default/edits", crater(x)))["number"], 1 + x / 100);
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
  EXPECT_EQ(bodyOf(ask(server.port(), "POST /v1/sessions/default/edits", crater(300)))["number"], 4);
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
