// The server's sessions and terrains as its HTTP routes list them; whatever else answers is refused.
#include "client/viewer/worlds.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

#include "tests/support/waiting.h"
#include "tests/unit/client/link/raw_server.h"

namespace ridgecast::viewer {
namespace {

using ridgecast::test::RawConnection;
using ridgecast::test::RawServer;

TEST(Worlds, AreRead) {
  const auto read =
      worldsFrom(R"({"sessions": [{"name": "race", "terrain": "canyon", "seed": 7, "members": 2, "more": []}, {"name": "a/b"}, 3]})",
                 R"({"terrains": [{"name": "alpine", "summary": "peaks", "parameters": []}]})");
  ASSERT_TRUE(read);
  ASSERT_EQ(read->sessions.size(), 1u);
  EXPECT_EQ(read->sessions[0].name, "race");
  EXPECT_EQ(read->sessions[0].terrain, "canyon");
  EXPECT_EQ(read->sessions[0].seed, 7u);
  EXPECT_EQ(read->sessions[0].members, 2u);
  ASSERT_EQ(read->terrains.size(), 1u);
  EXPECT_EQ(read->terrains[0].summary, "peaks");
}

TEST(Worlds, OfAHostileServerAreBoundedOrRefused) {
  const std::string none = R"({"terrains": []})";
  for (const char* text : {"", "[", "[]", "{}", R"({"sessions": 3})", R"({"sessions": {}})"}) EXPECT_FALSE(worldsFrom(text, none)) << text;
  EXPECT_FALSE(worldsFrom(R"({"sessions": []})", "{}"));
  std::string many;
  for (int k = 0; k < 1500; ++k) many += (k ? "," : "") + std::string(R"({"name": "s", "terrain": 5, "seed": "x", "members": -1})");
  const auto read = worldsFrom("{\"sessions\": [" + many + "]}", none);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->sessions.size(), Worlds::kMax);
  EXPECT_EQ(read->sessions[0].terrain, "");
}

std::optional<Outcome<Worlds>> answerTo(WorldsQuestion& question) {
  std::optional<Outcome<Worlds>> answer;
  EXPECT_TRUE(testing_support::await([&] { return (answer = question.take()).has_value(); }));
  return answer;
}

TEST(Worlds, ARefusalIsTheServersOwnSentence) {
  RawServer server([](RawConnection& c) {
    c.readHead();
    c.send("HTTP/1.1 403 Forbidden\r\nContent-Length: 9\r\n\r\nno token\n");
    c.drain();
  });
  core::Url url;
  url.port = server.port();
  WorldsQuestion question(url);
  const auto answer = answerTo(question);
  ASSERT_TRUE(answer && !*answer);
  EXPECT_NE(answer->error().message.find("no token"), std::string::npos) << answer->error().message;
}

TEST(Worlds, AServerThatSaysNothingHoldsNobodyUp) {
  RawServer server([](RawConnection& c) {
    c.readHead();
    c.drain();
  });
  core::Url url;
  url.port = server.port();
  WorldsQuestion question(url);
  EXPECT_FALSE(question.take());
}  // ends at once, not after the answer's timeout

}  // namespace
}  // namespace ridgecast::viewer
