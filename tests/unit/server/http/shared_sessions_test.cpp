// The sessions of several servers with one engine between them: a name is one world, limits count all servers, and what is asked of one
// server reaches the others.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/support/crater.h"
#include "tests/support/process.h"
#include "tests/unit/server/http/shared_sessions.h"

namespace ridgecast::http {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

TEST_F(SharedSessions, AreTheSameWorldOnAllServers) {
  start(), start();
  EXPECT_EQ(stream(0, "alps&terrain=flat&seed=7"), 101u);
  EXPECT_EQ(stream(1, "alps"), 101u) << "at once, by its name alone: " << body;
  EXPECT_EQ(find(0, "alps")->spec(), find(1, "alps")->spec());
  EXPECT_EQ(find(0, "alps")->contentHash(), find(1, "alps")->contentHash());
  EXPECT_EQ(stream(1, "alps&terrain=flat&seed=7"), 101u);
  leave(1, "alps");
  start();
  EXPECT_EQ(stream(2, "alps&terrain=flat&seed=8"), 409u);
  EXPECT_THAT(body, HasSubstr("is another world (terrain flat, seed 7)"));
  EXPECT_EQ(stream(2, "alps&clock=stepped"), 409u);
  EXPECT_FALSE(find(2, "alps"));
  EXPECT_EQ(stream(2, "alps&terrain=flat"), 101u) << body;
  EXPECT_EQ(find(2, "alps")->spec().seed, 7u);
  EXPECT_EQ(stream(2, "nowhere"), 404u);
  EXPECT_EQ(stream(0, "steps&terrain=flat&clock=stepped"), 101u);
  EXPECT_EQ(stream(1, "steps"), 101u);
  EXPECT_EQ(find(1, "steps")->spec().clock, wire::ClockMode::kStepped);
}

TEST_F(SharedSessions, OfTwoThatAreMadeAtOnceOneCounts) {
  start(), start();
  for (int round = 0; round < 50; ++round) {
    const std::string name = "n" + std::to_string(round);
    engine.slow(std::chrono::milliseconds(round % 7), 3ms);
    std::vector<DeferredResponse> works;
    for (int server : {0, 1}) {
      const std::string target = "/v1/stream?session=" + name + "&terrain=flat&seed=" + std::to_string(server + 1);
      Request request;
      request.method = "GET", request.target = target, request.client = "token of ann";
      request.upgrade = true, request.webSocketVersion = "13";
      works.push_back(std::get<DeferredResponse>(answer(request, *servers[server]->directory, "1")));
    }
    std::vector<Replied> replies;
    for (std::vector<std::optional<Replied>> made(2); !made[0] || !made[1]; pass(1ms))
      for (int k : {0, 1}) {
        if (made[k]) continue;
        Reply reply = works[k].work({});
        if (auto* next = std::get_if<DeferredResponse>(&reply))
          works[k] = DeferredResponse(std::move(*next));
        else if (!std::holds_alternative<RetryAt>(reply))
          replies.push_back(*(made[k] = Replied(std::move(reply))));
      }
    std::ranges::sort(replies, {}, &Replied::status);
    EXPECT_EQ(replies[0].status, 101u);
    EXPECT_EQ(replies[1].status, 409u);
    EXPECT_EQ(splits(), 0);
    for (int server : {0, 1}) servers[server]->directory->remove(name);
    pass(2s);
  }
}

TEST_F(SharedSessions, ATerrainFileThatDiffersIsRefusedWithBothHashesAndTheRemedy) {
  start(), start();
  servers[1]->files["flat"] = "other text";
  EXPECT_EQ(stream(0, "alps&terrain=flat"), 101u);
  EXPECT_EQ(stream(1, "alps"), 503u);
  EXPECT_THAT(body, AllOf(HasSubstr("other ground"), HasSubstr("give all servers the same terrain files"), HasSubstr("content hash")));
  EXPECT_FALSE(find(1, "alps"));
  servers[1]->files.clear();
  EXPECT_EQ(stream(1, "alps"), 101u);
}

TEST_F(SharedSessions, TheDefaultSessionIsTheSameOrTheServerDoesNotStart) {
  EXPECT_EQ(start(), "");
  EXPECT_EQ(start(), "");
  EXPECT_THAT(start({}, 2), AllOf(HasSubstr("seed 2"), HasSubstr("seed 1"), HasSubstr("start all with the same terrain")));
  servers.clear();
  pass(directory::kGrace + 1s);
  EXPECT_EQ(start({}, 2), "") << "nobody has the other any more";
}

TEST_F(SharedSessions, ANameOutlivesAServerThatCrashedAndNotTheSession) {
  session::Limits limits;
  limits.sessionIdle = 20s;
  start(limits), start(limits);
  ASSERT_EQ(stream(0, "alps&terrain=flat&seed=7"), 101u);
  pass(3s);
  servers[0].reset();
  pass(25s);
  EXPECT_EQ(stream(1, "alps"), 101u) << "its members find it elsewhere: " << body;
  EXPECT_EQ(find(1, "alps")->spec().seed, 7u);
  pass(60s);
  leave(1, "alps");
  pass(21s);
  EXPECT_FALSE(find(1, "alps")) << "idle";
  EXPECT_EQ(stream(1, "alps&terrain=flat&seed=8"), 409u) << "for a moment";
  pass(directory::kGrace);
  EXPECT_EQ(stream(1, "alps&terrain=flat&seed=8"), 101u) << body;
}

TEST_F(SharedSessions, AreListedOnEveryServerWithTheirMembersSummed) {
  start(), start();
  stream(0, "alps&terrain=flat"), stream(0, "alps"), stream(1, "alps"), stream(1, "sea&terrain=flat&seed=3");
  pass(2s);
  for (int server : {0, 1}) {
    const json all = list(server);
    EXPECT_EQ(all["alps"]["members"], 3);
    EXPECT_EQ(all["sea"]["members"], 1);
    EXPECT_EQ(all["sea"]["seed"], 3);
    EXPECT_EQ(std::set<int>(all["alps"]["servers"].begin(), all["alps"]["servers"].end()), (std::set{1, 2}));
    EXPECT_EQ(all["sea"]["servers"], json({2}));
    EXPECT_EQ(all["default"]["servers"].size(), 2u);
  }
  const json whole = json::parse(ask(0, "GET", "/v1/sessions").body);
  EXPECT_EQ(whole["servers"].size(), 2u);
  EXPECT_EQ(whole["servers"][0]["url"], "http://server2");
  servers[1].reset();
  pass(directory::kServerLife + 2s);
  EXPECT_EQ(list(0)["alps"]["members"], 2);
  EXPECT_FALSE(list(0).contains("sea"));
}

TEST_F(SharedSessions, EndOnAllServersWhicheverIsAsked) {
  start(), start(), start();
  for (int asked : {0, 1, 2}) {
    SCOPED_TRACE(asked);
    stream(0, "alps&terrain=flat&seed=1"), stream(1, "alps");
    pass(2s);
    servers[0]->removed.clear(), servers[1]->removed.clear();
    auto& directory = *servers[asked]->directory;
    EXPECT_TRUE(asked == 2 ? directory.removeElsewhere("alps") : directory.remove("alps") != nullptr);
    pass(2s);
    for (int server : {0, 1}) EXPECT_FALSE(find(server, "alps"));
    EXPECT_EQ(servers[0]->removed.size() + servers[1]->removed.size(), asked == 2 ? 2u : 1u);
    servers[0]->members.clear(), servers[1]->members.clear();
    EXPECT_EQ(stream(2, "alps&terrain=flat&seed=2"), 101u) << "its name is free: " << body;
    EXPECT_EQ(stream(0, "alps"), 101u);
    EXPECT_EQ(find(0, "alps")->spec().seed, 2u);
    servers[0]->members.clear(), servers[2]->members.clear();
    servers[2]->directory->remove("alps");
    pass(2s);
  }
  EXPECT_FALSE(servers[2]->directory->removeElsewhere("nowhere"));
  EXPECT_FALSE(servers[2]->directory->removeElsewhere("default"));
}

TEST_F(SharedSessions, AServerThatWasAwayEndsWhatWasEnded) {
  start(), start();
  stream(0, "alps&terrain=flat"), stream(1, "alps");
  pass(2s);
  engine.cut(busOf(1));
  servers[0]->directory->remove("alps");
  servers[0]->members.clear();
  EXPECT_EQ(stream(0, "alps&terrain=flat&seed=9"), 101u) << body;
  pass(60s);
  EXPECT_TRUE(find(1, "alps")) << "it cannot know";
  engine.mend(busOf(1));
  pass(5s);
  EXPECT_EQ(stream(1, "alps"), 101u);
  EXPECT_EQ(find(1, "alps")->spec().seed, 9u);
  EXPECT_EQ(splits(), 0);
}

TEST_F(SharedSessions, MembersAreSentAwayFromAnyServer) {
  start(), start();
  const std::uint64_t first = servers[0]->directory->nextCameraId(), second = servers[1]->directory->nextCameraId();
  EXPECT_EQ(first >> 32, 1u);
  EXPECT_EQ(second >> 32, 2u);
  EXPECT_LT(second, std::uint64_t{1} << 53);
  stream(0, "alps&terrain=flat"), stream(1, "alps");
  pass(2s);
  EXPECT_TRUE(servers[0]->directory->removeElsewhere("alps", second));
  EXPECT_FALSE(servers[0]->directory->removeElsewhere("alps", first));
  EXPECT_FALSE(servers[0]->directory->removeElsewhere("sea", second));
  EXPECT_EQ(servers[0]->directory->serverOf("alps", second)->url, "http://server2");
  pass(1s);
  EXPECT_THAT(servers[1]->removed, testing::ElementsAre("alps " + std::to_string(second)));
  EXPECT_THAT(servers[0]->removed, testing::IsEmpty());
}

TEST_F(SharedSessions, LimitsCountAllServers) {
  session::Limits limits;
  limits.maxSessions = 4;
  limits.maxSessionsPerClient = 2;
  limits.maxMembers = 3;
  start(limits), start(limits);
  EXPECT_EQ(stream(0, "a&terrain=flat"), 101u);
  EXPECT_EQ(stream(0, "b&terrain=flat"), 101u);
  pass(2s);
  EXPECT_EQ(stream(1, "c&terrain=flat"), 429u) << "two of ann's live";
  EXPECT_EQ(stream(1, "a"), 101u) << "hers, but not another: " << body;
  EXPECT_EQ(stream(1, "b", "token of bob"), 101u);
  EXPECT_EQ(stream(1, "c&terrain=flat", "token of bob"), 101u) << "joining made none of his";
  pass(2s);
  EXPECT_EQ(stream(0, "d&terrain=flat", "token of cat"), 503u) << "default, a, b and c";
  EXPECT_THAT(body, HasSubstr("These servers have 4 sessions"));
  EXPECT_EQ(stream(0, "c", "token of cat"), 101u);
  EXPECT_EQ(stream(0, "a"), 101u);
  pass(2s);
  EXPECT_EQ(stream(1, "a"), 1013u);
  EXPECT_THAT(body, HasSubstr("it has 3 members"));
  leave(0, "a");
  pass(2s);
  EXPECT_EQ(stream(1, "a"), 101u);
}

TEST_F(SharedSessions, ASessionThatLivesIsJoinedWithoutTheRightToCreate) {
  start(), start();
  const access::Rights view = access::Right::kView;
  EXPECT_EQ(stream(0, "alps&terrain=flat", "token of ann", view), 403u);
  EXPECT_EQ(stream(0, "alps&terrain=flat"), 101u);
  EXPECT_EQ(stream(1, "alps", "token of bob", view), 101u) << body;
  EXPECT_EQ(stream(1, "sea", "token of bob", view), 404u);
}

TEST_F(SharedSessions, PathsBelowASessionMakeItWhereTheyAreAsked) {
  start(), start();
  stream(0, "alps&terrain=flat&seed=7");
  const Replied reply = ask(1, "GET", "/v1/sessions/alps/edits", "token of bob", access::Right::kView);
  EXPECT_EQ(reply.body, "/v1/sessions/alps/edits token of bob\n");
  ASSERT_TRUE(find(1, "alps"));
  EXPECT_EQ(find(1, "alps")->spec().seed, 7u);
  EXPECT_EQ(ask(1, "GET", "/v1/sessions/sea/edits").status, 404u);
  EXPECT_FALSE(find(1, "sea"));
}

TEST_F(SharedSessions, WhatAClientSpendsOnOneServerIsChargedOnTheOthers) {
  start(), start();
  const auto third = engine.connect();
  std::size_t told = 0;
  const auto hearing = third->hear("directory/spent", [&told](const std::string&) { ++told; });
  const auto here = servers[0]->resources->budgets->of("token of ann", timer.now());
  const auto there = servers[1]->resources->budgets->of("token of ann", timer.now());
  const auto others = servers[1]->resources->budgets->of("token of bob", timer.now());
  here->queries.spend(timer.now(), 4 * session::kHeightsPerSecond);
  here->messages.spend(timer.now(), 10);  // does not matter
  const auto free = here->queries.free();
  pass(2s);
  EXPECT_GT(there->queries.free() - timer.now(), 1s);
  EXPECT_LE(there->queries.free(), free + 2s);
  EXPECT_EQ(here->queries.free(), free) << "not its own again";
  EXPECT_TRUE(others->areFull(timer.now()));
  EXPECT_TRUE(there->messages.isFull(timer.now()));
  EXPECT_EQ(told, 1u);
  pass(10s);
  EXPECT_EQ(told, 1u) << "nothing more was spent";
}

TEST_F(SharedSessions, EditsKeepANameForTheirGround) {
  session::Limits limits;
  limits.sessionIdle = 20s;
  start(limits), start(limits);
  ASSERT_EQ(stream(0, "site&terrain=flat&seed=7"), 101u);
  const auto session = find(0, "site");
  std::optional<Outcome<std::uint64_t>> number;
  engine.cut(busOf(0));
  session->edit({"", "ann", testing_support::craterAt(0)}, session->budgetsOf("x"), [&](const auto& n) { number = n; });
  pass(30s);
  ASSERT_TRUE(number && !*number) << "its name cannot be kept while the engine is away";
  engine.mend(busOf(0));
  pass(1s);
  session->edit({"", "ann", testing_support::craterAt(0)}, session->budgetsOf("x"), [&](const auto& n) { number = n; });
  pass(1s);
  ASSERT_TRUE(*number) << number->error().message;
  servers[0].reset();
  pass(60s);
  EXPECT_EQ(stream(1, "site&terrain=flat&seed=8"), 409u);
  EXPECT_EQ(stream(1, "site", "token of bob", access::Right::kView), 403u) << "it lives nowhere";
  EXPECT_EQ(stream(1, "site"), 101u) << body;
  EXPECT_EQ(find(1, "site")->spec().seed, 7u);
}

// A browser's cache survives the balancer, and a server's restart; and nothing else has the name of what it holds.
TEST_F(SharedSessions, EqualGroundHasOneHashAndOtherGroundAnother) {
  const testing_support::ScratchFolder folder;
  start({}, 1, folder / "first"), start({}, 1, folder / "second");
  const auto edit = [&](int server, double x) {
    const auto session = find(server, "default");
    session->edit({"", "ann", testing_support::craterAt(x)}, session->budgetsOf("x"), [](const auto& number) { EXPECT_TRUE(number); });
    pass(1s);
    return session->hashOf(session->ground());
  };
  const auto hashOn = [&](int server) {
    const auto session = find(server, "default");
    return session->hashOf(session->ground());
  };
  const std::uint64_t before = hashOn(0), first = edit(0, 0);
  EXPECT_NE(first, before);
  EXPECT_EQ(hashOn(1), first);
  const std::uint64_t second = edit(1, 20);
  EXPECT_NE(second, first);
  EXPECT_EQ(hashOn(0), second);
  servers[0].reset();
  start({}, 1, folder / "first"), start({}, 1, folder / "third");
  EXPECT_EQ(hashOn(2), second) << "restarted, with its own edits";
  EXPECT_EQ(hashOn(3), second) << "with those of the log";
  for (int server : {1, 3}) engine.cut(busOf(server));
  const std::uint64_t third = edit(2, 40);
  engine.cut(busOf(2));
  engine.loseEnd("default", 1);
  for (int server : {1, 3}) engine.mend(busOf(server));
  pass(3s);
  EXPECT_NE(edit(1, 60), third) << "another edit has its number";
  EXPECT_EQ(hashOn(1), hashOn(3));
}

// The engine has an edit before it is acknowledged, and other servers read it a moment later: a client that comes in between would find its
// world without it, and give up.
TEST_F(SharedSessions, AStreamBeginsWithAllThatIsAcknowledged) {
  start(), start();
  engine.slow(20ms);
  const auto first = find(0, "default");
  for (int k = 0; k < 3; ++k) {
    std::optional<Outcome<std::uint64_t>> number;
    first->edit({"", "ann", testing_support::craterAt(9 * k)}, first->budgetsOf("x"), [&](const auto& n) { number = n; });
    while (!number) pass(1ms);
    ASSERT_TRUE(*number) << number->error().message;
    EXPECT_LT(find(1, "default")->ground().edit, **number) << "it is behind";
    EXPECT_EQ(stream(1, "default"), 101u) << body;
    EXPECT_GE(find(1, "default")->ground().edit, **number);
  }
  engine.stop();
  pass(1s);
  EXPECT_EQ(stream(1, "default"), 101u) << "with what it has: " << body;
}

TEST_F(SharedSessions, GoOnWhileTheEngineIsAwayAndNoneIsMade) {
  start(), start();
  stream(0, "alps&terrain=flat");
  pass(2s);
  engine.stop();
  pass(2s);
  EXPECT_EQ(stream(0, "alps"), 101u);
  EXPECT_EQ(stream(1, "default"), 101u);
  EXPECT_EQ(stream(1, "alps"), 503u);
  EXPECT_THAT(body, HasSubstr("cannot be looked up on the others now"));
  EXPECT_EQ(stream(0, "sea&terrain=flat"), 503u);
  pass(60s);
  EXPECT_EQ(list(1)["alps"]["members"], 1) << "as it was";
  EXPECT_TRUE(find(0, "alps"));
  engine.start();
  pass(5s);
  EXPECT_EQ(stream(1, "alps"), 101u) << body;
  EXPECT_EQ(splits(), 0);
}

TEST_F(SharedSessions, AWorldWhoseRecordWasLostAndTakenIsLeftForTheOther) {
  start(), start();
  stream(0, "alps&terrain=flat&seed=1"), stream(0, "sea&terrain=flat&seed=1");
  pass(2s);
  engine.cut(busOf(0));
  engine.loseRecords();
  pass(100ms);
  EXPECT_EQ(stream(1, "alps&terrain=flat&seed=2"), 101u) << body;
  engine.mend(busOf(0));
  pass(5s);
  EXPECT_THAT(servers[0]->sentAway, testing::ElementsAre("alps"));
  EXPECT_EQ(stream(0, "alps"), 101u) << body;
  EXPECT_EQ(splits(), 0);
  EXPECT_EQ(stream(1, "sea&terrain=flat&seed=2"), 409u) << "written again";
}

TEST_F(SharedSessions, NeedAFolderForEachServer) {
  const testing_support::ScratchFolder folder;
  start({}, 1, folder / "state");
  EXPECT_THROW(start({}, 1, folder / "state"), std::runtime_error);
}

}  // namespace
}  // namespace ridgecast::http
