// A session's clock on several servers.
#include "server/clock/shared_clock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "server/clock/messages.h"
#include "tests/unit/server/clock/shared_clock.h"

namespace ridgecast::clock {
namespace {

using testing::HasSubstr;

TEST(SharedClock, OfTwoServersIsOneClock) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.advance(1s);
  const auto one = s.join(a, 1), two = s.join(b, 2);
  s.advance(1s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(a.clock->time(), 2'000'000u);
  b.clock->receive(2, kStepped);
  s.advance(0s);
  EXPECT_EQ(one->last().owner, 2u);
  a.clock->receive(1, kStepped);
  s.advance(0s);
  EXPECT_THAT(one->notice, HasSubstr("belongs to member 2"));
  EXPECT_EQ(b.clock->step(2, {20'000, true}), Clock::Stepped::kQueues);
  EXPECT_EQ(b.clock->step(2, {20'000, true}), Clock::Stepped::kQueues);
  s.advance(0s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(one->last().step, 1u);
  EXPECT_EQ(one->last().waitsFor, std::vector<std::uint64_t>{1});
  a.clock->receive(1, wire::StepDone{1});
  s.advance(0s);
  EXPECT_EQ(two->last().step, 2u);
  EXPECT_EQ(two->last().time, 2'040'000u);
  a.clock->leave(1);
  s.advance(1s);
  EXPECT_TRUE(b.clock->state().waitsFor.empty());
  EXPECT_TRUE(s.areEqual());
}

TEST(SharedClock, AnswersOnOtherServersThanTheLeaders) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.join(a, 1);
  const auto follows = s.join(b, 2), asks = s.join(b, 3, false);
  s.advance(1s);
  b.clock->step(2, {10, false});
  s.advance(0s);
  EXPECT_THAT(follows->notice, HasSubstr("Nobody owns the clock"));
  b.clock->receive(3, wire::SetClock{true, ClockMode::kScaled, 4});
  s.advance(0s);
  ASSERT_EQ(asks->clocks.size(), 1u) << "it follows nothing, and is answered";
  EXPECT_EQ(asks->last().rate, 4);
  b.clock->step(3, {10, false});
  s.advance(0s);
  EXPECT_THAT(asks->notice, HasSubstr("runs by itself"));
  b.clock->receive(3, wire::AskClock{7});
  EXPECT_EQ(asks->last().echo, 7u);
  b.clock->receive(3, wire::PassOver{9});
  s.advance(0s);
  EXPECT_THAT(asks->notice, HasSubstr("No step waits for member 9"));
  b.clock->receive(3, kStepped);
  b.clock->step(3, {10, true});
  b.clock->receive(3, wire::PassOver{1});
  s.advance(1s);
  EXPECT_EQ(b.clock->state().waitsFor, std::vector<std::uint64_t>{2});
  s.advance(30s);
  EXPECT_TRUE(b.clock->state().waitsFor.empty()) << "it was late";
  EXPECT_THAT(follows->notice, HasSubstr("not done within 30 s"));
  b.clock->leave(3);
  s.advance(1s);
  EXPECT_EQ(a.clock->state().owner, 0u);
}

TEST(SharedClock, GoesOnWhereItsLeaderLeftIt) {
  Servers s;
  s.start(), s.start(), s.start();
  s.join(s.servers[0], 1), s.join(s.servers[1], 2), s.join(s.servers[2], 3);
  s.advance(1s);
  s.servers[1].clock->receive(2, kStepped);
  s.servers[1].clock->step(2, {50, true});
  s.servers[1].clock->step(2, {50, true});
  s.advance(100ms);
  s.servers[2].clock->receive(3, wire::StepDone{1});
  s.advance(SharedClock::kTick);
  const std::uint64_t before = s.servers[1].clock->time();
  EXPECT_EQ(s.servers[1].clock->state().waitsFor.size(), 1u);
  s.crash(0);
  s.servers[0].clock->step(2, {50, true});  // nobody leads
  s.advance(2'500ms);
  EXPECT_EQ(s.servers[0].clock->state().step, 1u);
  s.advance(1s);
  EXPECT_EQ(s.servers[0].clock->state().step, 2u) << "another leads, and does not wait for the member of the one that is gone";
  s.servers[1].clock->receive(3, wire::StepDone{2});
  s.advance(100ms);
  EXPECT_EQ(s.servers[0].clock->state().step, 3u);
  EXPECT_EQ(s.servers[0].clock->time(), before + 100) << "each step once";
  EXPECT_TRUE(s.areEqual());
  s.start();
  s.advance(1s);
  EXPECT_TRUE(s.areEqual());
}

TEST(SharedClock, AnOrderlyEndIsNotWaitedFor) {
  Servers s;
  s.start(), s.start();
  s.join(s.servers[1], 2);
  s.advance(1s);
  const auto bus = s.servers[0].bus;
  s.servers.pop_front();
  s.advance(2 * SharedClock::kTick);
  s.servers[0].clock->receive(2, kStepped);
  s.advance(0s);
  EXPECT_EQ(s.servers[0].clock->state().owner, 2u);
}

TEST(SharedClock, StandsAndRefusesWithoutItsEngine) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  const auto one = s.join(a, 1), two = s.join(b, 2);
  s.advance(1s);
  b.clock->receive(2, wire::SetClock{true, ClockMode::kScaled, 10});
  s.advance(1s);
  EXPECT_EQ(a.clock->time(), 11'000'000u);
  s.engine.stop();
  s.advance(10s);
  EXPECT_EQ(a.clock->time(), 111'000'000u) << "it goes on as it is";
  for (auto* server : {&a, &b})
    for (const auto& [id, member] : server->members) {
      server->clock->receive(id, kStepped);
      EXPECT_THAT(member->notice, HasSubstr("cannot be reached"));
      member->notice.clear();
      server->clock->step(id, {10, true});
      EXPECT_THAT(member->notice, HasSubstr("cannot be reached"));
      EXPECT_TRUE(member->last().refuses);
    }
  s.join(a, 4);
  s.engine.start();
  s.advance(2s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(b.clock->state().mode, ClockMode::kScaled);
  b.clock->receive(2, kStepped);
  b.clock->step(2, {10, true});
  s.advance(100ms);
  EXPECT_EQ(b.clock->state().waitsFor, (std::vector<std::uint64_t>{1, 4})) << "who came meanwhile is a member";
}

TEST(SharedClock, OutlivesAllItsServers) {
  Servers s(1, ClockMode::kStepped);
  s.join(s.start(), 1);
  s.start();
  s.advance(1s);
  s.servers[0].clock->receive(1, kStepped);
  for (int k = 0; k < 5; ++k) s.servers[0].clock->step(1, {1000, false});
  s.advance(1s);
  s.crash(1), s.crash(0);
  s.advance(1h);
  s.start();
  s.advance(10s);
  EXPECT_EQ(s.servers[0].clock->time(), 5000u);
  EXPECT_EQ(s.servers[0].clock->state().step, 5u);
  EXPECT_EQ(s.servers[0].clock->state().owner, 0u) << "its members left";
  s.servers[0].clock->leave();
  s.advance(0s);
  s.servers.clear();
  s.start();
  s.advance(10s);
  EXPECT_EQ(s.servers[0].clock->state().step, 5u) << "the server left, and the session was not over";
  s.servers[0].clock->end();
  s.advance(0s);
  s.servers.clear();
  s.start();
  s.advance(1s);
  EXPECT_EQ(s.servers[0].clock->state().step, 0u) << "the session was over";
}

// A server shows a fast clock some milliseconds further than where it is stopped.
TEST(SharedClock, IsMovedToWhatSomebodyWasShown) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.join(a, 1), s.join(b, 2);
  s.advance(1s);
  a.clock->receive(1, wire::SetClock{true, ClockMode::kScaled, 1000});
  s.advance(1s);
  s.engine.slow(50ms);
  a.clock->receive(1, kStepped);
  for (int k = 0; k < 20; ++k) s.advance(10ms);
  const std::uint64_t ahead = b.clock->time();
  EXPECT_GT(ahead, a.clock->time());
  s.advance(2s);
  EXPECT_EQ(a.clock->time(), ahead);
  EXPECT_TRUE(s.areEqual());
}

// It is shown to who comes then, before anybody says how far it was shown.
TEST(SharedClock, IsStoppedWhereItIsWhenTheEngineHasRoomForThat) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.join(a, 1), s.join(b, 2);
  s.advance(1s);
  s.engine.fill();
  b.clock->receive(2, kStepped);
  for (int k = 0; k < 20; ++k) s.advance(100ms);
  EXPECT_EQ(a.clock->time(), 3'000'000u) << "it goes on as it is";
  s.engine.empty();
  for (int k = 0; k < 100 && a.clock->state().owner == 0; ++k) s.advance(10ms);
  Server& newest = s.start();
  s.advance(0s);
  EXPECT_EQ(newest.clock->state().owner, 2u);
  EXPECT_GE(newest.clock->time(), 3'000'000u);
  EXPECT_TRUE(s.areEqual());
}

// It was slow, and another leads now.
TEST(SharedClock, HearsNoMoreOfAnEarlierLeader) {
  Servers s;
  s.start();
  s.start(), s.start();
  s.join(s.servers[1], 1), s.join(s.servers[2], 2);
  s.advance(1s);
  const auto other = s.engine.connect();
  std::string key;
  bus::Record before;
  other->list("clock/", [&](auto all) { std::tie(key, before) = *all->begin(); });
  s.advance(100ms);
  s.crash(0);
  s.advance(5s);
  auto record = recordOf(before.value);
  ASSERT_TRUE(record);
  other->tell(key, toBytes(Told{before.epoch, false, *record, {}}));
  s.advance(10ms);
  for (Server& server : s.servers) {
    const std::uint64_t member = server.members.begin()->first;
    server.clock->receive(member, wire::SetClock{true, ClockMode::kScaled, 2});
    s.advance(10ms);
    EXPECT_EQ(server.clock->state().owner, member) << "the leader of now is asked";
    server.clock->receive(member, wire::SetClock{false, ClockMode::kRealTime, 1});
    s.advance(10ms);
  }
}

// Which another version of the program has written: this one does not write over what it cannot read.
TEST(SharedClock, LeavesARecordAloneThatItCannotRead) {
  Servers s;
  s.start();
  Server& b = s.start();
  s.join(b, 1);
  s.advance(1s);
  const auto other = s.engine.connect();
  std::map<std::string, bus::Record> records;
  const auto look = [&] {
    other->list("clock/", [&](auto all) { records = std::move(*all); });
    s.advance(100ms);
    ASSERT_EQ(records.size(), 1u);
  };
  look();
  s.crash(0);
  other->hold(records.begin()->first, "of the next version", records.begin()->second.epoch, 1h, [](const auto& held) {
    ASSERT_TRUE(held);
    EXPECT_TRUE(held->isYours);
  });
  s.advance(20s);
  look();
  EXPECT_EQ(records.begin()->second.value, "of the next version");
}

TEST(SharedClock, OnOneServerSendsNothingWhileNothingChanges) {
  Servers s;
  s.join(s.start(), 1);
  s.advance(10s);
  const auto before = s.engine.traffic();
  s.advance(30min);
  EXPECT_EQ(s.engine.traffic().tells, before.tells);
  EXPECT_EQ(s.engine.traffic().holds, before.holds);
  s.advance(3h);
  EXPECT_LE(s.engine.traffic().holds, before.holds + 4) << "the record is renewed";
}

TEST(SharedClock, MessagesAreReadAsTheyWereWritten) {
  Clock clock(Clock::Instant(7us), ClockMode::kStepped);
  for (std::uint64_t m : {3, 1, 1'000'000'007}) clock.follow(m);
  clock.set(1, kStepped, Clock::Instant(8us));
  for (int k = 0; k < 3; ++k) clock.step(1, {77, k != 1});
  clock.passOver(3);
  const Record record{9, 8, clock, {{5, {44, true, {1, 3}}}, {6, {45, false, {}}}}};
  const std::string told = toBytes(Told{3, true, record, {{1, "A sentence."}}});
  const auto read = toldOf(told);
  ASSERT_TRUE(read);
  EXPECT_EQ(toBytes(*read), told);
  EXPECT_EQ(read->record.clock.state(Clock::Instant(9us)).waitsFor, (std::vector<std::uint64_t>{1'000'000'007}));
  EXPECT_EQ(read->record.servers.at(5).members, (std::set<std::uint64_t>{1, 3}));
  ToldCalls calls{7, false, {{1, std::vector<ToldCalls::Member>{{4, true}, {5, false}}}}};
  for (const Call& call : {Call{Call::Kind::kSet, 4, {true, ClockMode::kScaled, 2.5, 9}}, Call{Call::Kind::kStep, 4, {}, {8, true}},
                           Call{Call::Kind::kDone, 4, {}, {}, 6}})
    calls.calls.push_back({2, {}, call});
  const std::string bytes = toBytes(calls);
  const auto back = toldCallsOf(bytes);
  ASSERT_TRUE(back);
  EXPECT_EQ(toBytes(*back), bytes);
  EXPECT_EQ(back->calls[1].call.set.rate, 2.5);
  for (std::size_t n = 0; n < told.size(); ++n) EXPECT_FALSE(toldOf(told.substr(0, n))) << n;
  for (std::size_t n = 0; n < bytes.size(); ++n) EXPECT_FALSE(toldCallsOf(bytes.substr(0, n))) << n;
  std::mt19937 random(3);
  for (int k = 0; k < 20'000; ++k) {  // hostile
    std::string other = k % 2 ? told : bytes;
    for (int n = 0; n < 3; ++n) other[random() % other.size()] = static_cast<char>(random());
    if (auto changed = toldOf(other)) changed->record.clock.leave(1'000'000'007, Clock::Instant(9us));
    (void)toldCallsOf(other);
  }
}

}  // namespace
}  // namespace ridgecast::clock
