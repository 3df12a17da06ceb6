#include "server/presence/presence.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <future>
#include <thread>

#include "common/wire/wire.h"
#include "tests/support/bytes.h"
#include "tests/support/waiting.h"

namespace ridgecast::presence {
namespace {

using namespace std::chrono_literals;
using Time = std::chrono::steady_clock;

// A member's end: keeps a table by the protocol's rules alone. While `reads` is false nothing leaves.
class Listener : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void> ticket) override {
    const std::lock_guard lock(mutex_);
    if (!reads) tickets_.push_back(std::move(ticket));
    if (const auto* m = std::get_if<wire::Members>(&message)) {
      times.push_back(Time::now());
      for (const auto& j : m->joined)
        if (!table.emplace(j.camera, j).second) complaint = "joined twice";
      for (const auto& v : m->moved) {
        if (!table.contains(v.camera)) complaint = "moved without having joined";
        table[v.camera].moved = v;
      }
      for (const auto camera : m->left)
        if (table.erase(camera) == 0) complaint = "left without having joined";
    } else if (const auto* c = std::get_if<wire::Clock>(&message)) {
      clocks.push_back(*c);
    }
    changed_.notify_all();
  }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    auto decoded = wire::decodeServer(testing_support::bytesOf(*encoded));
    ASSERT_TRUE(decoded) << decoded.error().message;
    send(std::move(*decoded), std::move(ticket));
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override {}
  void readOn() {
    const std::lock_guard lock(mutex_);
    reads = true;
    tickets_.clear();
  }
  template <class Condition>
  bool wait(const Condition& condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, testing_support::kTimeout, [&] { return condition(*this); });
  }
  std::size_t messages() {
    const std::lock_guard lock(mutex_);
    return times.size();
  }

  std::atomic<bool> reads{true};
  std::map<std::uint64_t, wire::Member> table;
  std::vector<Time::time_point> times;
  std::vector<wire::Clock> clocks;
  std::string complaint;

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::shared_ptr<const void>> tickets_;
};

wire::PoseMessage pose(std::uint64_t sequence, double y = 1) {
  wire::PoseMessage p;
  p.sequence = sequence;
  p.camera.pose.y = y;
  return p;
}

class PresenceTest : public testing::Test {
 protected:
  std::shared_ptr<Listener> join(std::uint64_t id, const std::string& name = "somebody", bool members = true, bool follows = true,
                                 wire::Role role = wire::Role::kViewer) {
    auto listener = std::make_shared<Listener>();
    wire::Hello hello;
    hello.clientName = name;
    hello.members = members;
    hello.clock = follows;
    hello.role = role;
    presence->join(id, hello, listener, {});
    return listener;
  }
  scheduling::SteadyTimer timer;
  std::shared_ptr<clock::SessionClock> clock = std::make_shared<clock::SessionClock>(timer);
  std::shared_ptr<Presence> presence = std::make_shared<Presence>(timer, clock);
};

TEST_F(PresenceTest, MembersSeeEachOtherComeMoveAndGo) {
  const auto a = join(1, "a");
  EXPECT_TRUE(a->wait([](Listener& l) { return l.times.size() == 1 && l.table.empty(); })) << "that nobody is there is told, too";
  const auto b = join(2, "b", true, true, wire::Role::kSensor);
  EXPECT_TRUE(a->wait([](Listener& l) { return l.table.contains(2); }));
  EXPECT_EQ(a->table[2].name, "b");
  EXPECT_EQ(a->table[2].role, wire::Role::kSensor);
  EXPECT_FALSE(a->table[2].moved);
  EXPECT_TRUE(b->wait([](Listener& l) { return l.table.contains(1); }));
  presence->receive(2, pose(1, 77));
  EXPECT_TRUE(a->wait([](Listener& l) { return l.table[2].moved && l.table[2].moved->pose.camera.pose.y == 77; }));
  presence->leave(2);
  EXPECT_TRUE(a->wait([](Listener& l) { return l.table.empty(); }));
  presence->receive(2, pose(2));
  EXPECT_EQ(a->complaint + b->complaint, "");
  EXPECT_FALSE(b->table.contains(2)) << "nobody is told of itself";
}

// A step that was taken after a client had received its world, and before it was a member, did not wait for it.
TEST_F(PresenceTest, WhoeverHasTheWorldIsAMember) {
  struct Entering final : conversation::Sender {
    explicit Entering(const Presence& of) : presence(of) {}
    void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
      if (std::holds_alternative<wire::World>(message))
        members = std::async(std::launch::async, [this] { return presence.state().members.size(); });
    }
    void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
    std::size_t queuedBytes() const override { return 0; }
    void fail(wire::ErrorMessage) override {}
    const Presence& presence;
    std::future<std::size_t> members;
  };
  const auto entering = std::make_shared<Entering>(*presence);
  presence->join(1, {}, entering, {}, wire::World{});
  EXPECT_EQ(entering->members.get(), 1u);
}

TEST_F(PresenceTest, WhoDidNotAskIsToldNothingButIsSeen) {
  const auto silent = join(1, "old client", false, false);
  const auto curious = join(2);
  EXPECT_TRUE(curious->wait([](Listener& l) { return l.table.contains(1); }));
  presence->receive(1, pose(1));
  EXPECT_TRUE(curious->wait([](Listener& l) { return l.table[1].moved.has_value(); }));
  EXPECT_TRUE(silent->times.empty() && silent->clocks.empty());
}

TEST_F(PresenceTest, ARecordingsMemberHasNoSenderAndIsToldNothing) {
  wire::Hello hello;
  hello.clock = true;
  presence->join(1, hello, nullptr, {});
  clock->receive(1, wire::AskClock{});
  clock->receive(1, wire::SetClock{});
  const auto other = join(2);
  EXPECT_TRUE(other->wait([](Listener& l) { return l.table.contains(1); }));
}

TEST_F(PresenceTest, ForASlowMemberChangesMerge) {
  const auto slow = join(1, "slow", true, false);
  ASSERT_TRUE(slow->wait([](Listener& l) { return l.times.size() == 1; }));
  slow->reads = false;
  const auto other = join(2);
  ASSERT_TRUE(slow->wait([](Listener& l) { return l.times.size() == 2; }));
  for (std::uint64_t k = 1; k <= 100; ++k) {
    wire::PoseMessage next = pose(k);
    next.state = {static_cast<std::uint8_t>(k)};
    presence->receive(2, next);
  }
  join(3);
  join(4);
  presence->leave(3);
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(slow->messages(), 2u) << "the one before has not left";
  slow->readOn();
  ASSERT_TRUE(slow->wait([](Listener& l) { return l.times.size() == 3; }));
  EXPECT_EQ(slow->table[2].moved->pose.sequence, 100u);
  EXPECT_EQ(slow->table[2].moved->pose.state, std::vector<std::uint8_t>{100});
  EXPECT_TRUE(slow->table.contains(4));
  EXPECT_FALSE(slow->table.contains(3)) << "it came and went in between: nobody needs to hear of it";
  EXPECT_EQ(slow->complaint, "");
}

TEST_F(PresenceTest, TheClockIsToldToThoseWhoFollowAndToThoseWhoAsk) {
  const auto owner = join(1, "owner"), follower = join(2, "follower"), asks = join(3, "asks", false, false);
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
  const std::uint64_t before = clock->state().time;
  EXPECT_EQ(clock->step(1, {20'000, true}), clock::Clock::Stepped::kBegins);
  ASSERT_TRUE(follower->wait([](Listener& l) { return !l.clocks.empty() && l.clocks.back().step == 1; }));
  EXPECT_EQ(follower->clocks.back().owner, 1u);
  EXPECT_EQ(follower->clocks.back().time, before + 20'000);
  EXPECT_EQ(follower->clocks.back().waitsFor, std::vector<std::uint64_t>{2});
  clock->receive(2, wire::StepDone{1});
  EXPECT_TRUE(owner->wait([](Listener& l) { return l.clocks.back().step == 1 && l.clocks.back().waitsFor.empty(); }));
  EXPECT_TRUE(asks->clocks.empty());
  clock->receive(3, wire::AskClock{99});
  ASSERT_EQ(asks->clocks.size(), 1u);
  EXPECT_EQ(asks->clocks[0].echo, 99u);
  clock->receive(2, wire::SetClock{true, wire::ClockMode::kRealTime, 1});
  EXPECT_EQ(follower->clocks.back().owner, 1u) << "the answer says whose it is";
  EXPECT_EQ(clock->step(3, {1, false}), clock::Clock::Stepped::kNotYours);
  EXPECT_EQ(presence->state().ownerName, "owner");
  presence->leave(1);
  EXPECT_EQ(clock->state().owner, 0u);
  EXPECT_EQ(clock->state().mode, wire::ClockMode::kStepped);
}

TEST_F(PresenceTest, TimeGoesBackInRecordingsAlone) {
  const auto owner = join(1, "owner");
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0, 50'000'000});
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0, 20'000'000});
  ASSERT_TRUE(owner->wait([](Listener& l) { return !l.clocks.empty() && !l.clocks.back().notice.empty(); }));
  EXPECT_EQ(owner->clocks.back().notice, "Time goes back only in recordings.");
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0, wire::kMaxTime});
  ASSERT_TRUE(owner->wait([](Listener& l) { return l.clocks.back().notice.starts_with("A jump"); }));
  EXPECT_EQ(owner->clocks.back().time, 50'000'000u);
  EXPECT_EQ(clock->state().time, 50'000'000u);
  std::vector<std::uint64_t> wanted;
  wire::Clock recording;
  recording.time = 60'000'000;
  recording.end = 90'000'000;
  clock->play(recording, [&](std::uint64_t time) { wanted.push_back(time); });
  ASSERT_TRUE(owner->wait([](Listener& l) { return l.clocks.back().end == 90'000'000; }));
  clock->receive(2, wire::SetClock{true, wire::ClockMode::kStepped, 0, 10});
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0, 70'000'000});
  EXPECT_TRUE(wanted.empty());
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0, 30'000'000});
  EXPECT_EQ(wanted, std::vector<std::uint64_t>{30'000'000});
  EXPECT_EQ(clock->state().time, 70'000'000u) << "nobody here sees time go back";
  for (std::size_t k = 1; k < owner->clocks.size(); ++k) EXPECT_GE(owner->clocks[k].time, owner->clocks[k - 1].time);
}

// However fast steps follow each other, what is read after one is of that one, and by a member that has not read the last, too.
TEST_F(PresenceTest, WhatHasChangedIsToldBeforeAStepBeginsAndBeforeItIsDone) {
  const auto owner = join(1), follower = join(2), other = join(3, "onlooker", true, false);
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 1});
  ASSERT_TRUE(owner->wait([](const Listener& l) { return l.table.size() == 2; }));
  ASSERT_TRUE(follower->wait([](const Listener& l) { return l.table.size() == 2; }));
  for (std::uint64_t k = 1; k <= 200; ++k) {
    k % 3 != 0 ? follower->readOn() : void(follower->reads = false);
    presence->receive(1, pose(k, 2.0 * static_cast<double>(k)));
    EXPECT_EQ(presence->step(1, {20'000, true}), clock::Clock::Stepped::kBegins);
    EXPECT_EQ(follower->table[1].moved->pose.sequence, k) << "before it begins";
    presence->receive(2, pose(k));
    presence->done(1, {k});
    presence->done(2, {k});
    EXPECT_EQ(owner->table[2].moved->pose.sequence, k) << "before it is done";
    EXPECT_TRUE(clock->beginsStep(1)) << "it is done";
  }
  EXPECT_LT(other->messages(), 100u) << "whom no step waits for is told as ever";
  for (const auto& l : {owner, follower, other}) EXPECT_EQ(l->complaint, "");
}

TEST_F(PresenceTest, StepsMergeForAMemberThatDoesNotReadAndOnesThatWaitArrive) {
  join(1, "owner");
  const auto slow = join(2, "slow", false);
  slow->reads = false;
  clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
  for (int k = 0; k < 1000; ++k) clock->step(1, {1, false});
  clock->step(1, {1, true});
  std::this_thread::sleep_for(30ms);
  EXPECT_LE(slow->clocks.size(), 3u);
  slow->readOn();
  EXPECT_TRUE(slow->wait([](Listener& l) { return l.clocks.back().step == 1001 && l.clocks.back().waitsFor.size() == 1; }));
}

TEST_F(PresenceTest, ManyThreadsAtOnceEndInOneTable) {
  const auto watcher = join(1000, "watcher");
  std::vector<std::thread> threads;
  for (std::uint64_t t = 1; t <= 4; ++t)
    threads.emplace_back([&, t] {
      for (std::uint64_t round = 0; round < 50; ++round) {
        const auto me = join(t * 100 + round);
        for (std::uint64_t k = 1; k < 20; ++k) presence->receive(t * 100 + round, pose(k));
        clock->receive(t * 100 + round, wire::SetClock{true, wire::ClockMode::kStepped, 0});
        clock->step(t * 100 + round, {1, true});
        if (round % 2 == 0) presence->leave(t * 100 + round);
      }
    });
  for (auto& t : threads) t.join();
  EXPECT_TRUE(watcher->wait([](Listener& l) { return l.table.size() == 100; }));
  EXPECT_EQ(watcher->complaint, "");
}

}  // namespace
}  // namespace ridgecast::presence
