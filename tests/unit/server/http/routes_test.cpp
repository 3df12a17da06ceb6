#include "server/http/routes.h"
#include "server/http/lists.h"
#include "tests/support/replies.h"
#include "tests/support/waiting.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace ridgecast::http {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing_support::Replied;

class RoutesTest : public testing::Test {
 protected:
  RoutesTest() {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    directory = std::make_unique<directory::Directory>(resources, terrain::create("alpine", 3).value());
  }
  Replied get(std::string_view target) {
    Request request;
    request.method = "GET";
    request.target = target;
    request.host = "example.org:7070";
    return answer(request, *directory, "9.9");
  }
  Replied connect(std::string_view target, std::string_view version = "13") {
    Request request;
    request.method = "GET";
    request.target = target;
    request.upgrade = true;
    request.webSocketVersion = version;
    return answer(request, *directory, "9.9");
  }
  scheduling::Executor executor{1};
  std::unique_ptr<directory::Directory> directory;
};

TEST_F(RoutesTest, AnswersWhatThereIs) {
  EXPECT_EQ(get("/healthz").body, "ok\n");
  EXPECT_EQ(get("/healthz?verbose=1").status, 200u);
  EXPECT_THAT(get("/version").body, HasSubstr(R"("version": "9.9", "protocol": 1)"));
  const auto page = get("/");
  EXPECT_EQ(page.status, 200u);
  EXPECT_THAT(page.type, HasSubstr("text/html"));
  EXPECT_THAT(page.body, testing::AllOf(HasSubstr("ridgecast-client view ws://example.org:7070"), HasSubstr("alpine, seed 3"),
                                        Not(HasSubstr("<script"))));
}

TEST_F(RoutesTest, RefusesTheRestInPlainWords) {
  for (const char* target : {"/nope", "", "/healthz/", "//", "/v1/stream/x", "*", "/%2e"}) {
    EXPECT_EQ(get(target).status, 404u) << target;
    EXPECT_THAT(get(target).type, HasSubstr("text/plain"));
  }
  Request post;
  post.method = "POST";
  post.target = "/healthz";
  EXPECT_EQ(Replied(answer(post, *directory, "")).status, 405u);
  post.target = "/v1/stream";
  post.method = "HEAD";
  EXPECT_EQ(Replied(answer(post, *directory, "")).status, 405u);
}

TEST_F(RoutesTest, AForeignHostHeaderNeverReachesThePage) {
  Request request;
  request.method = "GET";
  request.target = "/";
  request.host = "<script>alert(1)</script>";
  EXPECT_THAT(Replied(answer(request, *directory, "")).body, Not(HasSubstr("alert")));
}

TEST_F(RoutesTest, StreamsAreChosenByTheSessionsName) {
  EXPECT_EQ(connect("/v1/stream").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?session=default").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?a=b&session=def%61ult&c").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?sessions=other").upgradeTo, directory->find("default"));
  EXPECT_EQ(connect("/v1/stream?session=other").status, 404u);
  EXPECT_EQ(connect("/v1/stream?session=a%20b").status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=" + std::string(65, 'a')).status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=%g0").status, 400u);
  EXPECT_EQ(connect("/v1/stream?session=a%").status, 400u);
  EXPECT_EQ(get("/v1/stream").status, 426u);
  EXPECT_EQ(connect("/v1/stream", "8").status, 426u);
}

// A browser does not tell a page why its WebSocket was refused; the page asks again without an upgrade.
TEST_F(RoutesTest, ARequestWithoutAnUpgradeIsJudgedInTheSameWay) {
  for (const char* refused : {"/v1/stream?session=other", "/v1/stream?session=a%20b", "/v1/stream?terrain=canyon", "/v1/stream?seed=x",
                              "/v1/stream?session=other&terrain=alpine"}) {
    const Answer with = connect(refused), without = get(refused);
    EXPECT_GE(with.status, 400u) << refused;
    EXPECT_NE(with.status, 426u) << refused;
    EXPECT_EQ(without.status, with.status) << refused;
    EXPECT_EQ(without.body, with.body) << refused;
  }
}

TEST(QueryParameter, FirstOfItsNameDecoded) {
  EXPECT_EQ(*queryParameter("a=1&b=2&a=3", "a"), "1");
  EXPECT_EQ(*queryParameter("a=1&b", "b"), "");
  EXPECT_EQ(*queryParameter("", "b"), "");
  EXPECT_EQ(*queryParameter("&&=&b=%41%7a", "b"), "Az");
  EXPECT_FALSE(queryParameter("b=%4", "b"));
  EXPECT_FALSE(queryParameter("b=%", "b"));
  EXPECT_TRUE(queryParameter("a=%&b=1", "b"));
}

struct NoSender final : conversation::Sender {
  void send(wire::ServerMessage, std::shared_ptr<const void>) override {}
  void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override {}
};

class WorldsTest : public testing::Test {
 protected:
  explicit WorldsTest(std::uint32_t maxSessions = 4, bool makes = true, std::uint32_t perClient = 16) {
    auto resources = std::make_shared<session::Resources>();
    resources->executor = &executor;
    resources->makeMesh = session::pipelineMeshes();
    resources->limits.maxSessions = maxSessions;
    resources->limits.maxSessionsPerClient = perClient;
    resources->limits.sessionIdle = std::chrono::seconds(1);
    if (makes)
      resources->makeTerrain = [](const session::WorldSpec& spec, const std::stop_token&) {
        return terrain::create(spec.terrain, spec.seed);
      };
    directory = std::make_shared<directory::Directory>(resources, terrain::create("alpine", 3).value());
  }
  Replied connect(std::string_view target, std::string_view client = "address 192.0.2.1", bool upgrade = true) {
    Request request;
    request.method = "GET";
    request.target = target;
    request.client = client;
    request.upgrade = upgrade;
    request.webSocketVersion = upgrade ? "13" : "";
    return Replied(answer(request, *directory, "9.9")).made();
  }
  std::string list() {
    Request request;
    request.method = "GET";
    request.target = "/v1/sessions";
    return Replied(answer(request, *directory, "9.9")).body;
  }
  scheduling::Executor executor{1};
  std::shared_ptr<directory::Directory> directory;
};

TEST_F(WorldsTest, WithoutAnUpgradeAWorldIsJudgedAndNotMade) {
  const auto ask = [&](std::string_view target) { return connect(target, "address 192.0.2.1", false); };
  const Answer unknown = ask("/v1/stream?session=new&terrain=canyons");
  EXPECT_EQ(unknown.status, 400u);
  EXPECT_EQ(unknown.body, connect("/v1/stream?session=new&terrain=canyons").body);
  EXPECT_EQ(ask("/v1/stream?session=new&terrain=canyon").status, 426u);
  EXPECT_EQ(directory->find("new"), nullptr);
}

TEST_F(WorldsTest, ListsTheTerrainsWithTheirParameters) {
  Request request;
  request.method = "GET";
  request.target = "/v1/terrains";
  const auto listed = [&](std::optional<std::filesystem::path> folder) {
    return Replied(answer(request, *directory, "9.9", {terrainsRoute(std::move(folder))})).made();
  };
  const Answer all = listed("");
  EXPECT_EQ(all.status, 200u);
  EXPECT_THAT(all.body,
              AllOf(HasSubstr(R"("name":"canyon")"), HasSubstr(R"("name":"snowLine","default":1760.0,"least":500.0,"most":4000.0)")));
  EXPECT_EQ(listed(std::nullopt).body, "{\"terrains\":[]}\n");
  EXPECT_EQ(listed("/nowhere").status, 503u);
  request.method = "POST";
  EXPECT_EQ(listed("").status, 405u);
}

TEST_F(WorldsTest, AUrlMakesAWorldOrJoinsIt) {
  const Replied made = connect("/v1/stream?session=hills&terrain=canyon&seed=7");
  ASSERT_EQ(made.status, 101u);
  EXPECT_EQ(made.upgradeTo->terrain()->name(), "canyon");
  EXPECT_EQ(made.upgradeTo->terrain()->seed(), 7u);
  for (const char* same : {"/v1/stream?session=hills", "/v1/stream?session=hills&terrain=canyon", "/v1/stream?session=hills&seed=7",
                           "/v1/stream?session=hills&terrain=canyon&seed=7"})
    EXPECT_EQ(connect(same).upgradeTo, made.upgradeTo) << same;
  for (const char* other : {"/v1/stream?session=hills&terrain=alpine", "/v1/stream?session=hills&seed=8",
                            "/v1/stream?session=hills&param=depth=3", "/v1/stream?terrain=canyon"}) {
    const Answer a = connect(other);
    EXPECT_EQ(a.status, 409u) << other;
    EXPECT_THAT(a.body, HasSubstr("another world"));
  }
  EXPECT_EQ(connect("/v1/stream?session=default&terrain=alpine&seed=3").status, 101u);
  EXPECT_EQ(connect("/v1/stream?session=nowhere").status, 404u);
  EXPECT_EQ(connect("/v1/stream?session=nowhere&seed=1").status, 404u);
}

TEST_F(WorldsTest, AUrlSaysHowTheClockBegins) {
  const Replied made = connect("/v1/stream?session=lab&terrain=canyon&clock=stepped");
  ASSERT_EQ(made.status, 101u);
  const wire::Clock clock = made.upgradeTo->clock().state();
  EXPECT_EQ(clock.mode, wire::ClockMode::kStepped);
  EXPECT_EQ(clock.time, 0u);
  for (const char* same : {"/v1/stream?session=lab", "/v1/stream?session=lab&clock=stepped", "/v1/stream?session=lab&clock="})
    EXPECT_EQ(connect(same).upgradeTo, made.upgradeTo) << same;
  const Answer other = connect("/v1/stream?session=lab&clock=real-time");
  EXPECT_EQ(other.status, 409u);
  EXPECT_EQ(other.body, "Session 'lab' began with clock=stepped; leave clock=real-time out to join it, or choose another name.\n");
  EXPECT_EQ(connect("/v1/stream?clock=stepped").status, 409u) << "the default session's runs";
  EXPECT_EQ(connect("/v1/stream?clock=real-time").status, 101u);
  EXPECT_EQ(connect("/v1/stream?session=usual&terrain=canyon&clock=real-time").upgradeTo->clock().state().mode, wire::ClockMode::kRealTime);
  EXPECT_EQ(connect("/v1/stream?session=none&clock=stepped").status, 404u) << "a clock makes no world";
  // What its members do with it later is no reason to keep out who comes again.
  made.upgradeTo->presence().join(1, {}, std::make_shared<NoSender>(), {});
  made.upgradeTo->clock().receive(1, wire::SetClock{true, wire::ClockMode::kRealTime, 1});
  EXPECT_EQ(connect("/v1/stream?session=lab&clock=stepped").upgradeTo, made.upgradeTo);
  ASSERT_TRUE(directory->replace(made.upgradeTo, made.upgradeTo->terrain()));
  EXPECT_EQ(directory->find("lab")->clock().state().mode, wire::ClockMode::kStepped) << "a successor begins in the same way";
}

TEST_F(WorldsTest, WhatIsNoWorldIsSaidInASentence) {
  for (const char* wrong : {"terrain=../../etc/passwd", "terrain=a.glsl", "terrain=%00", "terrain=%zz", "terrain=alpine&seed=-1",
                            "terrain=alpine&seed=4294967296", "terrain=alpine&seed=1x", "terrain=alpine&param=depth",
                            "terrain=alpine&param=a=nan", "terrain=alpine&param=a=1&param=b=2&param=a=1", "terrain=alpine&param=a=1e999",
                            "terrain=atlantis", "terrain=alpine&clock=scaled", "terrain=alpine&clock=%"}) {
    const Answer a = connect("/v1/stream?session=new&" + std::string(wrong));
    EXPECT_EQ(a.status, 400u) << wrong;
    EXPECT_TRUE(a.body.ends_with(".\n") || a.body.find("there is:") != std::string::npos) << a.body;
  }
  EXPECT_EQ(directory->all().size(), 1u);
}

TEST_F(WorldsTest, ThereAreOnlySoManyAndIdleOnesEnd) {
  for (const char* name : {"a", "b", "c"}) EXPECT_EQ(connect("/v1/stream?terrain=alpine&session=" + std::string(name)).status, 101u);
  EXPECT_EQ(connect("/v1/stream?terrain=alpine&session=d").status, 503u);
  auto place = directory->find("b")->enter();
  ASSERT_TRUE(place);
  const auto old = directory->find("a");
  EXPECT_TRUE(testing_support::await([&] { return directory->all().size() == 2; })) << "default, and the one that somebody is in";
  EXPECT_FALSE(old->enter()) << "who found it just before is told to come again";
  EXPECT_EQ(connect("/v1/stream?terrain=canyon&session=a").upgradeTo->terrain()->name(), "canyon") << "the name is free again";
  EXPECT_TRUE(directory->find("b"));
}

class SharesTest : public WorldsTest {
 protected:
  SharesTest() : WorldsTest(7, true, 2) {}
};

TEST_F(SharesTest, AreByTokenHolderOrAddress) {
  auto make = [&, k = 0](std::string_view client, std::string_view terrain = "alpine") mutable {
    return connect("/v1/stream?terrain=" + std::string(terrain) + "&session=s" + std::to_string(++k), client);
  };
  for (const std::string_view client : {"address 192.0.2.1", "token of lab"}) {
    EXPECT_EQ(make(client).status, 101u);
    EXPECT_EQ(make(client).status, 101u);
    const Answer third = make(client);
    EXPECT_EQ(third.status, 429u);
    EXPECT_EQ(third.body, "The " + std::string(client) +
                              " has made 2 of the sessions that live here, the most one client may; leave one until it ends, or join one "
                              "by its name.\n");
    EXPECT_EQ(connect("/v1/stream?session=s1", client).status, 101u) << "joining is free";
  }
  EXPECT_EQ(make("token of others").status, 101u);
  EXPECT_EQ(make("address 192.0.2.2").status, 101u);
  EXPECT_EQ(make("address 192.0.2.3").status, 503u) << "the server has 7";
  EXPECT_TRUE(testing_support::await([&] { return directory->all().size() == 1; }));
  EXPECT_EQ(make("token of lab").status, 101u) << "those it had made have ended";
}

TEST_F(WorldsTest, AreListed) {
  connect("/v1/stream?terrain=canyon&session=hills&seed=9");
  const std::string all = list();
  EXPECT_THAT(all, HasSubstr(R"({"name":"default","terrain":"alpine","seed":3,"parameters":{})"));
  EXPECT_THAT(all, HasSubstr(R"({"name":"hills","terrain":"canyon","seed":9)"));
  EXPECT_THAT(all, HasSubstr(R"("mode":"real-time")"));
  EXPECT_THAT(all, HasSubstr(R"("max_sessions":4)"));
}

class ClosedWorldsTest : public WorldsTest {
 protected:
  ClosedWorldsTest() : WorldsTest(4, false) {}
};

TEST_F(ClosedWorldsTest, AServerThatMakesNoneSaysSo) {
  EXPECT_EQ(connect("/v1/stream?session=new&terrain=alpine").status, 403u);
  EXPECT_EQ(connect("/v1/stream?session=default").status, 101u);
}

}  // namespace
}  // namespace ridgecast::http
