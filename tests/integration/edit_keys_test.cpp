// Whose an edit is and what its key is worth, by tokens and addresses, over the stream and HTTP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "server/http/edits.h"
#include "tests/integration/access_fixture.h"
#include "tests/integration/edits_fixture.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using link::Connection;
using testing::HasSubstr;

class EditKeysTest : public AccessTest {
 protected:
  std::vector<http::Route> routes() override {
    const auto holdsAPlace = [this](const http::Request& request) -> std::optional<http::Reply> {
      if (request.path() != "/v1/held") return {};
      return http::DeferredResponse{.work = [this](const http::Turn&) -> http::Reply {
        isHeld = true;
        if (holds) return http::RetryAt{std::chrono::steady_clock::now() + 1ms};
        return http::plain(200, "let go");
      }};
    };
    return {http::editsRoute(directory), holdsAPlace};
  }
  void startWithTokens() {
    settings.tokens.tokens = file("tokens", lab.line + "\n" + guest.line + "\n");
    start();
  }
  std::unique_ptr<Connection> join(const std::string& name, const std::string& token = "") const {
    auto url = core::parseUrl("ws://127.0.0.1:" + std::to_string(server->port())).value();
    url.token = token;
    wire::Hello hello;
    hello.clientName = name;
    hello.edits = true;
    return Connection::open(url, hello, {.reconnects = false, .timeout = testing_support::kTimeout}).value();
  }
  static std::uint64_t make(Connection& connection, const std::string& operation, const std::string& key) {
    const auto answer = connection.edit({0, key, operation}).get();
    EXPECT_TRUE(answer) << answer.error().message;
    return answer ? answer->number : 0;
  }
  std::string post(const std::string& operation, const std::string& key = "", const std::string& token = "") const {
    SocketClient client(server->port());
    client.send("POST /v1/sessions/default/edits HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\n" +
                (key.empty() ? "" : "Idempotency-Key: " + key + "\r\n") + (token.empty() ? "" : "Authorization: Bearer " + token + "\r\n") +
                "Content-Length: " + std::to_string(operation.size()) + "\r\n\r\n" + operation);
    return client.answer();
  }
  static std::string number(int n) { return "{\"number\": " + std::to_string(n) + "}"; }
  // The budgets of this machine's clients, who owe for minutes while they are held.
  std::shared_ptr<session::Budgets> owing() const {
    auto budgets = directory->find("default")->budgetsOf("address 127.0.0.1");
    budgets->edits.spend(resources->timer->now(), 600 * session::kEditedPostsPerSecond);
    return budgets;
  }
  std::uint64_t last() const { return directory->find("default")->ground().edit; }

  const access::NewToken lab = access::makeToken({"lab", access::Rights::all(), "", {}}),
                         guest = access::makeToken({"guest", access::Rights::all(), "", {}});
  std::atomic<bool> holds{true}, isHeld{false};
};

TEST_F(EditKeysTest, ANameThatImitatesGainsNothing) {
  startWithTokens();
  const auto liar = join("token of lab", guest.token);
  EXPECT_EQ(make(*liar, craterAt(0), "k"), 1u);
  EXPECT_THAT(post(craterAt(50), "k", lab.token), HasSubstr(number(2)));
  const auto unnamed = join("", lab.token);
  EXPECT_EQ(make(*unnamed, craterAt(50), "k"), 2u) << "of one holder, without a name, as over HTTP";
  std::vector<wire::MadeEdit> told;
  ASSERT_TRUE(testing_support::await([&] {
    for (auto& edit : unnamed->takeEdits().made) told.push_back(std::move(edit));
    return told.size() >= 2;
  }));
  EXPECT_EQ(told[0].author, "token of guest");
  EXPECT_EQ(told[1].author, "token of lab");
}

TEST_F(EditKeysTest, TheAuthorIsTheHolderAndTheNameStandsBesideIt) {
  startWithTokens();
  const auto ann = join("ann", lab.token);
  EXPECT_EQ(make(*ann, craterAt(0), ""), 1u);
  std::vector<wire::MadeEdit> told;
  ASSERT_TRUE(testing_support::await([&] { return !(told = ann->takeEdits().made).empty(); }));
  EXPECT_EQ(told[0].author, "token of lab");
  EXPECT_EQ(told[0].name, "ann");
  EXPECT_THAT(get("/v1/sessions/default/edits", "Authorization: Bearer " + guest.token + "\r\n"),
              HasSubstr(R"({"number": 1, "author": "token of lab", "name": "ann", "edit": )"));
}

TEST_F(EditKeysTest, WithoutTokensAKeyIsTheAddressesAndTheNames) {
  settings.trustedProxies = {access::Network::parse("127.0.0.1").value()};
  start();
  const auto from = [&](const std::string& address, const std::string& operation) {
    SocketClient client(server->port());
    client.send("POST /v1/sessions/default/edits HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\n" +
                ("X-Forwarded-For: " + address) + "\r\nIdempotency-Key: k\r\nContent-Length: " + std::to_string(operation.size()) +
                "\r\n\r\n" + operation);
    return client.answer();
  };
  const auto liar = join("address 192.0.2.1");
  EXPECT_EQ(make(*liar, craterAt(0), "k"), 1u);
  EXPECT_THAT(from("192.0.2.1", craterAt(50)), HasSubstr(number(2)));
  EXPECT_THAT(from("192.0.2.2", craterAt(90)), HasSubstr(number(3)));
  EXPECT_THAT(from("192.0.2.1", craterAt(50)), HasSubstr(number(2)));
  EXPECT_EQ(last(), 3u);
}

// 429 means that nothing was made, of which 503 says nothing.
TEST_F(EditKeysTest, WithoutAPlaceForTheAnswerNothingIsMade) {
  settings.promptJobs = {1, 1};  // a client's share is one
  start();
  auto held = std::async(std::launch::async, [&] { return get("/v1/held"); });
  ASSERT_TRUE(testing_support::await([&] { return isHeld.load(); }));
  for (int k = 0; k < 5; ++k) EXPECT_THAT(post(craterAt(k), "k" + std::to_string(k)), HasSubstr(" 429 "));
  holds = false;
  EXPECT_THAT(held.get(), HasSubstr("let go"));
  EXPECT_THAT(post(craterAt(90)), HasSubstr(number(1))) << "refused with 429, and made";
  EXPECT_EQ(last(), 1u);
}

TEST_F(EditKeysTest, WhatIsNotPaidForIsRefusedWith429) {
  start();
  const auto budgets = owing();
  const std::string answer = post(craterAt(0), "k");
  EXPECT_THAT(answer, HasSubstr(" 429 "));
  EXPECT_THAT(answer, HasSubstr("Retry-After: 1"));
  EXPECT_THAT(answer, HasSubstr("again in"));
  EXPECT_EQ(last(), 0u);
}

}  // namespace
}  // namespace ridgecast
