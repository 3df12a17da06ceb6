// The sessions of several servers with one engine between them: a name is one world, limits count all servers, and what is asked of one
// server reaches the others.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "server/directory/directory.h"
#include "server/http/routes.h"
#include "server/http/worlds.h"
#include "tests/support/crater.h"
#include "tests/support/process.h"
#include "tests/support/replies.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::http {
namespace {

using namespace std::chrono_literals;
using directory::Directory;
using nlohmann::json;
using session::Session;
using testing::AllOf;
using testing::HasSubstr;
using testing_support::Replied;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;

// Its ground is its file's.
class FileTerrain final : public terrain::Terrain {
 public:
  FileTerrain(std::string name, std::uint32_t seed, std::string file) : name_(std::move(name)), seed_(seed), file_(std::move(file)) {}
  std::string_view name() const override { return name_; }
  std::string_view source() const override { return file_; }
  std::uint32_t seed() const override { return seed_; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    std::ranges::fill(out, 0.0f);
  }

 private:
  const std::string name_;
  const std::uint32_t seed_;
  const std::string file_;
};

class TestTimer final : public session::Timer {  // of all servers
 public:
  explicit TestTimer(const SimulatedTimer& all) : all_(all) {}
  Time now() const override { return all_.now(); }
  void at(Time when, std::function<void()> call) const override { all_.at(when, std::move(call)); }

 private:
  const SimulatedTimer& all_;
};

class SharedSessions : public testing::Test {
 protected:
  struct Server {
    ~Server() {
      members.clear();
      directory.reset();
      executor.work();
    }
    scheduling::Executor executor{scheduling::Executor::WithoutThreads{}};
    std::shared_ptr<session::Resources> resources = std::make_shared<session::Resources>();
    std::shared_ptr<Directory> directory;
    std::map<std::string, std::string> files;  // by terrain; others are empty
    std::vector<std::string> removed, sentAway;
    bool hasLeft = false;
    std::map<std::shared_ptr<Session>, std::vector<session::Membership>> members;
  };

  explicit SharedSessions(std::uint64_t seed = 1) : engine(timer, seed) {}

  // The sentence of its refusal, empty: it serves.
  std::string start(const session::Limits& limits = {}, std::uint32_t defaultSeed = 1, const std::filesystem::path& state = {}) {
    auto server = std::make_unique<Server>();
    Server& s = *server;
    s.resources->executor = &s.executor;
    s.resources->timer = std::make_unique<TestTimer>(timer);
    s.resources->limits = limits;
    s.resources->state = state;
    s.resources->bus = engine.connect();
    s.resources->makeTerrain = [&s](const session::WorldSpec& spec,
                                    const std::stop_token&) -> Outcome<std::shared_ptr<const terrain::Terrain>> {
      return std::make_shared<const FileTerrain>(spec.terrain, spec.seed, s.files[spec.terrain]);
    };
    const auto terrain = std::make_shared<FileTerrain>("home", defaultSeed, "");
    std::optional<Outcome<void>> claimed;
    Directory::claimDefault(*s.resources, *terrain, {}, [&](Outcome<void> c) { claimed = std::move(c); });
    timer.advance(1s);
    if (!claimed) return "no answer";
    if (!*claimed) return claimed->error().message;
    s.directory = std::make_shared<Directory>(s.resources, terrain);
    s.directory->join({.url = "http://server" + std::to_string(s.resources->bus->server()),
                       .load = [] { return 0.25; },
                       .entry = sessionEntry,
                       .remove =
                           [&s](const Session& session, std::optional<std::uint64_t> camera) {
                             s.removed.push_back(session.name() + (camera ? " " + std::to_string(*camera) : ""));
                             if (!camera) std::erase_if(s.members, [&](const auto& m) { return m.first.get() == &session; });
                           },
                       .sendAway =
                           [&s](const Session& session) {
                             s.sentAway.push_back(session.name());
                             std::erase_if(s.members, [&](const auto& m) { return m.first.get() == &session; });
                           },
                       .leave = [&s] { s.hasLeft = true; }});
    servers.push_back(std::move(server));
    pass(1s);
    return "";
  }

  void pass(SimulatedTimer::Time::duration time) {
    for (const auto end = timer.now() + time; timer.step(end);)
      for (const auto& server : servers)
        if (server) server->executor.work();
  }

  Replied ask(int server, std::string method, std::string target, std::string client = "token of ann",
              access::Rights rights = access::Rights::all()) {
    Request request;
    request.method = method;
    request.target = target;
    request.host = "localhost";
    request.client = client;
    request.rights = rights;
    request.upgrade = target.starts_with("/v1/stream");
    request.webSocketVersion = "13";
    request.contentType = "application/json";
    Reply reply = answer(request, *servers[server]->directory, "1", {editsRoute()});
    request = {};
    std::string().swap(target);  // the work has its own copies
    for (int turns = 0; turns < 10'000; ++turns) {
      auto* const later = std::get_if<DeferredResponse>(&reply);
      if (!later) return Replied(std::move(reply));
      Reply next = later->work({});
      if (std::holds_alternative<RetryAt>(next))
        pass(1ms);
      else
        reply = std::move(next);
    }
    ADD_FAILURE() << method << " was never answered";
    return Replied(Answer{.status = 0});
  }
  // Answers edits by their session, to see whose they would be.
  Route editsRoute() const {
    return [](const Request& request) -> std::optional<Reply> {
      if (!request.path().ends_with("/edits")) return std::nullopt;
      return http::plain(200, std::string(request.target) + " " + std::string(request.client));
    };
  }
  // 101: one more member is in it.
  unsigned stream(int server, const std::string& query, const std::string& client = "token of ann",
                  access::Rights rights = access::Rights::all()) {
    const Replied reply = ask(server, "GET", "/v1/stream?session=" + query, client, rights);
    body = reply.body;
    if (!reply.upgradeTo) return reply.status;
    auto place = reply.upgradeTo->enter(client);
    if (!place) return body = place.error().message, 1013;
    reply.upgradeTo->use();
    servers[server]->members[reply.upgradeTo].push_back(std::move(*place));
    return 101;
  }
  void leave(int server, const std::string& name) {
    std::erase_if(servers[server]->members, [&](const auto& m) { return m.first->name() == name; });
  }
  std::shared_ptr<Session> find(int server, const std::string& name) const { return servers[server]->directory->find(name); }
  json list(int server) {
    const json all = json::parse(ask(server, "GET", "/v1/sessions").body);
    json byName;
    for (const json& session : all["sessions"]) byName[session["name"].get<std::string>()] = session;
    return byName;
  }
  // How many names are two worlds.
  int splits() const {
    std::map<std::string, std::set<std::pair<std::string, std::uint64_t>>> worlds;
    for (const auto& server : servers)
      if (server)
        for (const auto& session : server->directory->all())
          worlds[session->name()].emplace(session->spec().terrain + std::to_string(session->spec().seed), session->contentHash());
    return static_cast<int>(std::ranges::count_if(worlds, [](const auto& w) { return w.second.size() > 1; }));
  }
  bus::Bus& busOf(int server) const { return *servers[server]->resources->bus; }

  SimulatedTimer timer;
  SimulatedEngine engine;
  std::vector<std::unique_ptr<Server>> servers;
  std::string body;
};

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

// Requests at random, servers that come, crash and lose touch for less than a record lives: a name is never two worlds, not for a moment.
TEST(SharedSessionsAtRandom, AreNeverSplit) {
  struct World : SharedSessions {
    explicit World(std::uint64_t seed) : SharedSessions(seed), random(seed) {}
    void TestBody() override {}
    int any(int below) { return static_cast<int>(random() % below); }
    void run() {
      session::Limits limits;
      limits.sessionIdle = 15s;
      for (int k = 0; k < 3; ++k) start(limits);
      std::map<int, SimulatedTimer::Time> cutSince;
      int joined = 0;
      for (int step = 0; step < 300; ++step) {
        const int server = any(static_cast<int>(servers.size()));
        const std::string name = "n" + std::to_string(any(6));
        const int what = any(20);
        if (what < 10) {
          joined += stream(server, name + (any(2) ? "&terrain=flat&seed=" + std::to_string(any(3)) : "")) == 101;
        } else if (what < 13) {
          leave(server, name);
        } else if (what == 13 && cutSince.empty()) {  // a server that is away cannot know
          servers[server]->directory->remove(name);
          leave(server, name);
          pass(2500ms);  // of those that can hear it
        } else if (what == 14) {
          engine.slow(std::chrono::milliseconds(any(40)), std::chrono::milliseconds(1 + any(20)));
        } else if (what == 15 && !cutSince.contains(server)) {
          engine.cut(busOf(server));
          cutSince[server] = timer.now();
        } else if (what == 16 && servers.size() < 5) {
          start(limits);
        } else if (what == 17 && servers.size() > 2) {
          if (server + 1 == static_cast<int>(servers.size()) && !cutSince.contains(server)) servers.pop_back();
        } else {
          pass(std::chrono::milliseconds(any(2500)));
        }
        for (auto it = cutSince.begin(); it != cutSince.end();) {
          if (timer.now() - it->second < 5s) {
            ++it;
            continue;
          }
          engine.mend(busOf(it->first));
          it = cutSince.erase(it);
          pass(3s);
        }
        ASSERT_EQ(splits(), 0) << "step " << step;
      }
      EXPECT_GT(joined, 50);
    }
    std::mt19937_64 random;
  };
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE(seed);
    World(seed).run();
    if (testing::Test::HasFailure()) return;
  }
}

}  // namespace
}  // namespace ridgecast::http
