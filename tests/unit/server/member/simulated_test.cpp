// Presence and the directory under a simulated timer: hours in milliseconds, exact to the tick.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <vector>

#include "common/wire/wire.h"
#include "server/presence/presence.h"
#include "tests/support/bytes.h"
#include "tests/support/simulated_timer.h"
#include "tests/support/waiting.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing_support::SimulatedTimer;

struct Watcher final : conversation::Sender {
  explicit Watcher(const scheduling::Timer& t) : timer(t) {}
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    if (const auto* members = std::get_if<wire::Members>(&message)) {
      times.push_back(timer.now());
      bytes += wire::encode(message).size();
      for (const wire::Moved& moved : members->moved) last = moved.pose.sequence;
    }
    if (const auto* clock = std::get_if<wire::Clock>(&message)) clocks.push_back(*clock);
  }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    send(wire::decodeServer(testing_support::bytesOf(*encoded)).value(), std::move(ticket));
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override { ADD_FAILURE(); }

  const scheduling::Timer& timer;
  std::vector<scheduling::Timer::Time> times;
  std::vector<wire::Clock> clocks;
  std::uint64_t last = 0;
  std::size_t bytes = 0;  // of Members
};

// Gives resources a timer that the test moves; they own it.
SimulatedTimer& simulateTime(Resources& resources) {
  auto timer = std::make_unique<SimulatedTimer>();
  SimulatedTimer& moved = *timer;
  resources.timer = std::move(timer);
  return moved;
}

TEST(Simulated, AMemberIsNotifiedTwentyTimesASecondAndOfTheLastPose) {
  SimulatedTimer timer;
  const auto clock = std::make_shared<clock::SessionClock>(timer);
  const auto presence = std::make_shared<presence::Presence>(timer, clock);
  wire::Hello hello;
  hello.members = true;
  const auto watcher = std::make_shared<Watcher>(timer), other = std::make_shared<Watcher>(timer);
  presence->join(1, hello, watcher, {});
  presence->join(2, {}, other, {});
  constexpr std::uint64_t kPoses = 10'000;
  for (std::uint64_t k = 1; k <= kPoses; ++k) {
    wire::PoseMessage pose;
    pose.sequence = k;
    presence->receive(2, pose);
    timer.advance(1ms);
  }
  timer.advance(1s);
  EXPECT_GE(watcher->times.size(), 199u);
  EXPECT_LE(watcher->times.size(), 202u);
  for (std::size_t k = 1; k < watcher->times.size(); ++k)
    EXPECT_GE(watcher->times[k] - watcher->times[k - 1], presence::Presence::kMinPause);
  EXPECT_EQ(watcher->last, kPoses);
  EXPECT_TRUE(other->times.empty());
  EXPECT_EQ(timer.pending(), 0u) << "nothing runs while nothing changes";
}

TEST(Simulated, NewsOfMembersTakeAQuarterOfABudgetOfBytes) {
  SimulatedTimer timer;
  const auto clock = std::make_shared<clock::SessionClock>(timer);
  const auto presence = std::make_shared<presence::Presence>(timer, clock);
  wire::Hello hello;
  hello.members = true;
  const auto watcher = std::make_shared<Watcher>(timer), other = std::make_shared<Watcher>(timer);
  presence->join(1, hello, watcher, {});
  presence->setBudget(1, kMinBytesPerSecond);
  presence->join(2, {}, other, {});
  for (std::uint64_t k = 1; k <= 1'000; ++k) {
    presence->receive(2, {k, {}, std::vector<std::uint8_t>(wire::kMaxStateBytes)});
    timer.advance(10ms);
  }
  EXPECT_GT(watcher->bytes, 8 * kMinBytesPerSecond / 4);
  EXPECT_LT(watcher->bytes, 11 * kMinBytesPerSecond / 4);
  timer.advance(1s);
  EXPECT_EQ(watcher->last, 1'000u);
  const std::size_t taken = presence->takeBytes(1);
  EXPECT_EQ(taken, watcher->bytes);
  EXPECT_EQ(presence->takeBytes(1), 0u);
  EXPECT_EQ(timer.pending(), 0u);
}

TEST(Simulated, TheClockIsTheTimers) {
  SimulatedTimer timer;
  const auto clock = std::make_shared<clock::SessionClock>(timer);
  const auto presence = std::make_shared<presence::Presence>(timer, clock);
  const auto watcher = std::make_shared<Watcher>(timer);
  presence->join(1, {}, watcher, {});
  timer.advance(36h);
  clock->receive(1, wire::AskClock{7});
  ASSERT_EQ(watcher->clocks.size(), 1u);
  EXPECT_EQ(watcher->clocks[0].time, std::uint64_t{36} * 3600 * 1'000'000);
  EXPECT_EQ(watcher->clocks[0].echo, 7u);
}

// A session whose clock is stepped by member 1; 2 and 3 follow it.
struct Stepping {
  Stepping() {
    wire::Hello hello;
    hello.clock = true;
    for (const auto& [id, watcher] : {std::pair(1u, owner), std::pair(2u, slow), std::pair(3u, other)})
      presence->join(id, hello, watcher, {});
    clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
  }
  SimulatedTimer timer;
  const std::shared_ptr<clock::SessionClock> clock = std::make_shared<clock::SessionClock>(timer);
  const std::shared_ptr<presence::Presence> presence = std::make_shared<presence::Presence>(timer, clock);
  const std::shared_ptr<Watcher> owner = std::make_shared<Watcher>(timer), slow = std::make_shared<Watcher>(timer),
                                 other = std::make_shared<Watcher>(timer);
};
std::vector<std::uint64_t> waitedFor(const Stepping& s) { return s.clock->state().waitsFor; }
using testing::HasSubstr;

TEST(Simulated, AStepByAnotherMemberIsAnsweredWithASentence) {
  Stepping s;
  EXPECT_EQ(s.clock->step(2, {10, false}), clock::Clock::Stepped::kNotYours);
  EXPECT_THAT(s.slow->clocks.back().notice, HasSubstr("belongs to member 1"));
  s.clock->receive(2, wire::SetClock{true, wire::ClockMode::kRealTime, 1});
  EXPECT_THAT(s.slow->clocks.back().notice, HasSubstr("belongs to member 1"));
  s.clock->receive(2, wire::AskClock{3});
  EXPECT_EQ(s.slow->clocks.back().notice, "");
  s.presence->leave(1);
  EXPECT_EQ(s.clock->step(2, {10, false}), clock::Clock::Stepped::kNotYours);
  EXPECT_THAT(s.slow->clocks.back().notice, HasSubstr("Nobody owns the clock"));
}

TEST(Simulated, AMemberThatNeverSaysDoneIsPassedOverAndTold) {
  Stepping s;
  s.clock->step(1, {10, true});
  s.clock->step(1, {10, true});
  s.clock->receive(3, wire::StepDone{1});
  s.timer.advance(29s);
  EXPECT_EQ(waitedFor(s), std::vector<std::uint64_t>{2});
  s.timer.advance(1s);
  EXPECT_EQ(s.clock->state().step, 2u) << "one member stops all";
  EXPECT_EQ(waitedFor(s), std::vector<std::uint64_t>{3}) << "a member that was passed over is waited for no longer";
  for (const auto& told : {s.slow, s.owner}) EXPECT_THAT(told->clocks.back().notice, HasSubstr("Member 2 was passed over at step 1"));
  EXPECT_EQ(s.other->clocks.back().notice, "");
  s.timer.advance(20s);
  EXPECT_EQ(waitedFor(s), std::vector<std::uint64_t>{3}) << "each step has its own time";
  s.clock->receive(2, wire::StepDone{2});
  s.clock->receive(3, wire::StepDone{2});
  s.clock->step(1, {10, true});
  EXPECT_EQ(waitedFor(s), (std::vector<std::uint64_t>{2, 3})) << "done with the newest step, it follows again";
  for (std::uint64_t k = 3; k < 1000; ++k) {
    s.clock->receive(2, wire::StepDone{k});
    s.clock->receive(3, wire::StepDone{k});
    s.clock->step(1, {10, true});
    s.timer.advance(1ms);
  }
  EXPECT_LE(s.timer.pending(), 1u) << "one call at a time, however many steps";
}

TEST(Simulated, TheOwnerRemovesWhoIsNotDone) {
  Stepping s;
  s.clock->step(1, {10, true});
  s.clock->receive(2, wire::PassOver{3});
  EXPECT_EQ(waitedFor(s), (std::vector<std::uint64_t>{2, 3})) << "only the owner may";
  EXPECT_THAT(s.slow->clocks.back().notice, HasSubstr("belongs to member 1"));
  s.clock->receive(1, wire::PassOver{99});
  EXPECT_THAT(s.owner->clocks.back().notice, HasSubstr("No step waits for member 99"));
  s.clock->receive(1, wire::PassOver{2});
  EXPECT_EQ(waitedFor(s), std::vector<std::uint64_t>{3});
  EXPECT_THAT(s.slow->clocks.back().notice, HasSubstr("passed over at step 1"));
  s.clock->receive(3, wire::StepDone{1});
  s.clock->step(1, {10, true});
  EXPECT_EQ(waitedFor(s), std::vector<std::uint64_t>{3});
}

// Sessions end after an hour without members.
struct IdleHour {
  IdleHour() {
    resources->executor = &executor;
    resources->limits.sessionIdle = 1h;
    directory = std::make_shared<Directory>(resources, flatTerrain());
  }
  scheduling::Executor executor{1};
  std::shared_ptr<Resources> resources = std::make_shared<Resources>();
  SimulatedTimer& timer = simulateTime(*resources);
  std::shared_ptr<Directory> directory;
};

TEST(Simulated, SessionsEndWhenTheyWereEmptyForLongEnough) {
  const IdleHour server;
  const std::shared_ptr<Directory>& directory = server.directory;
  const auto visited = directory->add("visited", flatTerrain(7)).value();
  ASSERT_TRUE(directory->add("empty", flatTerrain(8)));
  {
    const auto place = visited->enter();
    visited->use();
    server.timer.advance(3h);
    EXPECT_EQ(directory->find("empty"), nullptr);
    EXPECT_EQ(directory->find("visited"), visited);
  }
  server.timer.advance(1h);
  EXPECT_EQ(directory->find("visited"), visited) << "an hour has not passed since it was seen to be empty";
  server.timer.advance(1h);
  EXPECT_EQ(directory->find("visited"), nullptr);
  EXPECT_NE(directory->find(kDefaultName), nullptr);
}

TEST(Simulated, ASessionThatIsUsedWithoutMembersStays) {
  const IdleHour server;
  const std::shared_ptr<Directory>& directory = server.directory;
  const auto used = directory->add("used", flatTerrain(7)).value();
  for (int k = 0; k < 10; ++k) {
    used->use();
    server.timer.advance(30min);
  }
  EXPECT_EQ(directory->find("used"), used);
  server.timer.advance(2h);
  EXPECT_EQ(directory->find("used"), nullptr);
}

TEST(Simulated, WhoNeverAcknowledgesIsToldSo) {
  scheduling::Executor executor(1);
  auto resources = std::make_shared<Resources>();
  SimulatedTimer& timer = simulateTime(*resources);
  resources->executor = &executor;
  const auto script = std::make_shared<Script>();
  script->next = [](int n, const camera::Camera&) { return Script::State{{{{0, 1, 2}, n}}, false}; };
  resources->makeMesh = scriptedMeshes(script);
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  const auto session = directory->find(kDefaultName);
  const auto client = std::make_shared<Client>();
  const auto camera = std::make_shared<CameraSession>(session, session->enter().value(), 1, client);
  camera->receive(wire::Hello{});
  ASSERT_TRUE(client->world());
  camera->receive(wire::PoseMessage{1, {}});
  for (std::uint32_t k = 0; k < client->world()->window; ++k) ASSERT_TRUE(client->iteration());
  ASSERT_TRUE(client->quiet());
  timer.advance(CameraSession::kAcknowledgeTimeout - 1s);
  camera->receive(wire::Acknowledge{1, 0});
  ASSERT_TRUE(client->iteration()) << "there was room again";
  ASSERT_TRUE(client->quiet());
  timer.advance(CameraSession::kAcknowledgeTimeout - 1s);
  EXPECT_TRUE(client->quiet()) << "the time begins with what it waits for now";
  camera->receive(wire::Acknowledge{2, 0});
  ASSERT_TRUE(client->iteration());
  ASSERT_TRUE(client->quiet());
  timer.advance(CameraSession::kAcknowledgeTimeout - 1s);
  EXPECT_TRUE(client->quiet());
  timer.advance(1s);  // and ends to the second
  const auto error = client->error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, wire::ErrorCode::kLimit);
  EXPECT_THAT(error->message, HasSubstr("acknowledge"));
  camera->close();
}

// Cameras in the default session of a server that has 1,000,000 triangles for four.
struct Room : testing::Test {
  struct Member {
    std::shared_ptr<Client> client = std::make_shared<Client>();
    std::shared_ptr<CameraSession> camera;
    std::uint32_t granted() const { return client->granted().empty() ? first : client->granted().back().triangleBudget; }
    std::uint32_t first = 0;  // granted with the world
  };
  void SetUp() override {
    resources->executor = &executor;
    resources->limits.maxCameras = 4;
    resources->limits.maxTotalTriangles = 1'000'000;
    script->next = [](int, const camera::Camera&) { return Script::State{{{{0, 1, 2}, 1}}, true}; };
    resources->makeMesh = scriptedMeshes(script);
    directory = std::make_shared<Directory>(resources, flatTerrain());
  }
  void TearDown() override {
    for (const auto& camera : cameras) camera->close();
  }
  Member join(std::uint32_t budget, wire::Pacing pacing = wire::Pacing::kFree) {
    Member member;
    const auto session = directory->find(kDefaultName);
    member.camera = std::make_shared<CameraSession>(session, session->enter().value(), directory->nextCameraId(), member.client);
    cameras.push_back(member.camera);
    wire::Hello hello;
    hello.pacing = pacing;
    hello.settings.triangleBudget = budget;
    member.camera->receive(hello);
    const auto world = member.client->world();
    EXPECT_TRUE(world);
    member.first = world ? world->settings.triangleBudget : 0;
    member.camera->receive(wire::PoseMessage{1, {}});
    EXPECT_TRUE(member.client->iteration());
    return member;
  }
  void leave(Member& member) {
    member.camera->close();
    std::erase(cameras, member.camera);
    member.camera.reset();
    EXPECT_TRUE(testing_support::await([&] { return directory->cameras() == cameras.size(); }));
  }
  void pass(scheduling::Timer::Time::duration time) {
    timer.advance(time);
    EXPECT_TRUE(testing_support::await([&] { return executor.queued() == 0; }));
  }

  std::shared_ptr<Script> script = std::make_shared<Script>();
  scheduling::Executor executor{1};
  std::shared_ptr<Resources> resources = std::make_shared<Resources>();
  SimulatedTimer& timer = simulateTime(*resources);
  std::shared_ptr<Directory> directory;
  std::vector<std::shared_ptr<CameraSession>> cameras;
};

TEST_F(Room, ACameraThatWasGrantedLittleGetsMoreWhenThereIsRoom) {
  Member first = join(600'000), second = join(600'000);
  ASSERT_EQ(first.first, 600'000u);
  ASSERT_EQ(second.first, 380'000u);
  pass(5 * CameraSession::kSeeksRoom);
  EXPECT_TRUE(second.client->granted().empty()) << "there is no room";
  // Somebody leaves and comes back: nothing is taken.
  leave(first);
  pass(CameraSession::kSeeksRoom);
  first = join(600'000);
  EXPECT_EQ(first.first, 600'000u);
  pass(5 * CameraSession::kSeeksRoom);
  EXPECT_TRUE(second.client->granted().empty());
  // For good: it is told, with the first iteration of its new mesh.
  leave(first);
  pass(CameraSession::kSeeksRoom);
  EXPECT_TRUE(second.client->granted().empty());
  pass(CameraSession::kSeeksRoom);
  EXPECT_TRUE(testing_support::await([&] { return second.granted() == 600'000u; }));
  EXPECT_TRUE(testing_support::await([&] { return directory->triangles() == 600'000u; }));
  pass(10 * CameraSession::kSeeksRoom);
  EXPECT_EQ(second.client->granted().size(), 1u) << "it has all that it asked for";
  EXPECT_EQ(script->changes.size(), 1u);
}

TEST_F(Room, LessThanTwiceAsMuchIsNotWorthAnotherMesh) {
  Member large = join(600'000), half = join(350'000), small = join(600'000);
  ASSERT_EQ(small.first, 40'000u);
  leave(half);
  Member other = join(325'000);
  ASSERT_EQ(other.first, 325'000u);
  pass(5 * CameraSession::kSeeksRoom);
  EXPECT_TRUE(small.client->granted().empty()) << "65,000 would be left for it";
  leave(other);
  pass(2 * CameraSession::kSeeksRoom);
  EXPECT_TRUE(testing_support::await([&] { return small.granted() == 380'000u; })) << "not all, but twice and more";
}

TEST_F(Room, InLockStepNobodyElseChangesTheMesh) {
  Member first = join(600'000), second = join(600'000, wire::Pacing::kLockstep);
  leave(first);
  pass(10 * CameraSession::kSeeksRoom);
  EXPECT_TRUE(second.client->granted().empty());
}

TEST(Simulated, SessionsInWhichNobodySaidHelloEndWithinSeconds) {
  scheduling::Executor executor(1);
  auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  SimulatedTimer& timer = simulateTime(*resources);
  resources->limits.maxSessionsPerClient = 3;
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  ASSERT_TRUE(directory->add("operators", flatTerrain(6)));
  ASSERT_TRUE(directory->add("empty", flatTerrain(7), {}, "address 192.0.2.1"));
  const auto silent = directory->add("silent", flatTerrain(8), {}, "address 192.0.2.1").value();
  const auto greeted = directory->add("greeted", flatTerrain(9), {}, "address 192.0.2.1").value();
  EXPECT_TRUE(directory->full("address 192.0.2.1")->isOwn);
  {
    const auto place = silent->enter(), member = greeted->enter();
    greeted->use();
    timer.advance(2s);
    EXPECT_NE(directory->find("empty"), nullptr);
    timer.advance(5s);
    EXPECT_EQ(directory->find("empty"), nullptr);
    EXPECT_EQ(directory->find("silent"), silent) << "somebody is in it, who may still say hello";
  }
  timer.advance(7s);
  EXPECT_EQ(directory->find("silent"), nullptr);
  EXPECT_NE(directory->find("operators"), nullptr);
  EXPECT_EQ(directory->find("greeted"), greeted) << "it has " << resources->limits.sessionIdle.count() << " ms";
  EXPECT_FALSE(directory->full("address 192.0.2.1"));
}

TEST(Simulated, RepairsOnManyConnectionsOfOneClientHaveOneBudget) {
  scheduling::Executor executor(2);
  auto resources = std::make_shared<Resources>();
  SimulatedTimer& timer = simulateTime(*resources);
  resources->executor = &executor;
  const auto script = std::make_shared<Script>();
  Script::State large{{}, true};  // more bytes than a quarter of a second's
  for (int k = 0; k < 10'000; ++k) large.leaves[{0, k % 100, k / 100}] = 1 + k;
  script->next = [&](int, const camera::Camera&) { return large; };
  resources->makeMesh = scriptedMeshes(script);
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  const auto session = directory->find(kDefaultName);
  struct Connection {
    std::shared_ptr<Client> client = std::make_shared<Client>();
    std::shared_ptr<CameraSession> camera;
  };
  const auto enter = [&](const std::string& holder) {
    Connection c;
    c.camera = std::make_shared<CameraSession>(session, session->enter(holder).value(), directory->nextCameraId(), c.client);
    c.camera->receive(wire::Hello{});
    c.camera->receive(wire::PoseMessage{1, {}});
    const auto first = c.client->iteration();
    if (first) c.camera->receive(wire::Acknowledge{first->number, first->meshHash});
    return c;
  };
  const Connection one = enter("token of lab"), two = enter("token of lab"), other = enter("token of else");
  one.camera->receive(wire::ResendLeaves{});
  ASSERT_TRUE(one.client->iteration()) << "the first repair comes at once";
  two.camera->receive(wire::ResendLeaves{});
  other.camera->receive(wire::ResendLeaves{});
  EXPECT_TRUE(other.client->iteration()) << "another client's";
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == 1 || two.client->sent() > 1; }));
  EXPECT_EQ(two.client->sent(), 1u) << "it has a budget of its own";
  timer.advance(10s);
  EXPECT_TRUE(two.client->iteration());
  for (const Connection& c : {one, two, other}) c.camera->close();
}

// A member who asks for 256 rays at a time, none of which meets the ground within 100 km: nearly a quarter of a second of the budget.
class SimulatedQueries : public testing::Test {
 protected:
  struct Asker final : conversation::Sender {
    void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
      worlds += std::holds_alternative<wire::World>(message);
      answers += std::holds_alternative<wire::Answer>(message);
    }
    void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
    std::size_t queuedBytes() const override { return 0; }
    void fail(wire::ErrorMessage) override { ++errors; }
    std::atomic<int> worlds{0}, answers{0}, errors{0};
  };
  void SetUp() override {
    resources->executor = &executor;
    resources->makeMesh = scriptedMeshes(script);
    directory = std::make_shared<Directory>(resources, flatTerrain());
    const auto session = directory->find(kDefaultName);
    camera = std::make_shared<CameraSession>(session, session->enter().value(), 1, asker);
    camera->receive(wire::Hello{});
    ASSERT_TRUE(testing_support::await([&] { return asker->worlds == 1; }));
  }
  void TearDown() override {
    camera->close();
    EXPECT_EQ(asker->errors, refused);
  }
  static wire::Query longRays() {
    wire::Query query;
    query.kind = wire::QueryKind::kRays;
    query.rays.assign(256, {.y = 5000, .directionX = 1, .directionY = 1, .reach = 1e5});
    return query;
  }
  void askForLongRays(int queries) {
    for (int k = 0; k < queries; ++k) camera->receive(longRays());
  }

  scheduling::Executor executor{1};
  std::shared_ptr<Resources> resources = std::make_shared<Resources>();
  SimulatedTimer& timer = simulateTime(*resources);
  std::shared_ptr<Script> script = std::make_shared<Script>();
  std::shared_ptr<Asker> asker = std::make_shared<Asker>();
  std::shared_ptr<Directory> directory;
  std::shared_ptr<CameraSession> camera;
  int refused = 0;
};

TEST_F(SimulatedQueries, OnlySoManyAreOpen) {
  refused = 1;
  askForLongRays(static_cast<int>(wire::kMaxQueries) + 3);  // the time stands still, so at most two are answered
  EXPECT_EQ(asker->errors, 1);
}

TEST_F(SimulatedQueries, WhatExceedsAMembersBudgetWaits) {
  askForLongRays(20);
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == 1 || asker->answers == 20; }));
  ASSERT_LE(asker->answers, 2) << "a quarter of a second of the budget was saved up";
  timer.advance(1s);
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == 1; }));
  EXPECT_GE(asker->answers, 1);
  EXPECT_LE(asker->answers, 7);
  for (int k = 0; k < 1000 && asker->answers < 20; ++k) {
    timer.advance(100ms);
    testing_support::await([&] { return timer.pending() == 1 || asker->answers == 20; });
  }
  EXPECT_EQ(asker->answers, 20);
}

TEST_F(SimulatedQueries, ManyConnectionsOfOneClientHaveOneBudget) {
  const auto session = directory->find(kDefaultName);
  const auto all = std::make_shared<Asker>(), other = std::make_shared<Asker>();
  std::vector<std::shared_ptr<CameraSession>> cameras;
  const auto enter = [&](const std::string& client, const std::shared_ptr<Asker>& sender) {
    const int worlds = sender->worlds + 1;
    cameras.push_back(std::make_shared<CameraSession>(session, session->enter(client).value(), 2 + cameras.size(), sender));
    cameras.back()->receive(wire::Hello{});
    ASSERT_TRUE(testing_support::await([&] { return sender->worlds == worlds; }));
    for (int k = 0; k < 3; ++k) cameras.back()->receive(longRays());
  };
  constexpr int kConnections = 8;
  for (int k = 0; k < kConnections; ++k) enter("token of lab", all);
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == kConnections; }));
  EXPECT_LE(all->answers, 2) << "each has a budget of its own";
  enter("address 192.0.2.1", other);
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == kConnections + 1; })) << "it pays for the others";
  EXPECT_GE(other->answers, 1);
  const int before = all->answers;
  for (const auto& one : cameras) one->close();
  cameras.clear();
  enter("token of lab", all);
  ASSERT_TRUE(testing_support::await([&] { return timer.pending() == kConnections + 3; })) << "and memory is given back";
  EXPECT_EQ(all->answers, before) << "who connects again owes nothing";
  timer.advance(10s);
  EXPECT_TRUE(testing_support::await([&] { return all->answers > before; }));
  cameras.back()->close();
}

TEST_F(SimulatedQueries, LongRaysLeaveOthersTheirTurns) {
  const auto honest = executor.makePool();
  std::promise<void> bothWait;  // the only thread is held until then
  honest->post([held = bothWait.get_future().share()] { held.wait(); });
  askForLongRays(1);
  std::atomic<int> turns{0};  // until the answer
  std::function<void()> turn = [&] {
    if (asker->answers > 0) return;
    ++turns;
    honest->post(turn);
  };
  honest->post(turn);
  bothWait.set_value();
  ASSERT_TRUE(testing_support::await([&] { return asker->answers == 1; }));
  EXPECT_GE(turns, 2) << "256 rays were cast in so few turns";
  std::promise<void> last;
  honest->post([&] { last.set_value(); });
  last.get_future().wait();
}

}  // namespace
}  // namespace ridgecast::session
