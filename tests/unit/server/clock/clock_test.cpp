#include "server/clock/clock.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "common/wire/wire.h"

namespace ridgecast::clock {
namespace {

using namespace std::chrono_literals;
using wire::ClockMode;
using Stepped = Clock::Stepped;

constexpr Clock::Instant kStart{};

TEST(Clock, RunsInRealTimeUntilSomebodySetsIt) {
  Clock clock(kStart);
  EXPECT_EQ(clock.state(kStart).time, 0u);
  const wire::Clock later = clock.state(kStart + 1500ms);
  EXPECT_EQ(later.time, 1'500'000u);
  EXPECT_EQ(later.mode, ClockMode::kRealTime);
  EXPECT_EQ(later.rate, 1);
  EXPECT_EQ(later.owner, 0u);
}

TEST(Clock, StandsAtZeroFromItsBeginningWhereItIsStepped) {
  Clock clock(kStart, ClockMode::kStepped);
  const wire::Clock begun = clock.state(kStart + 1h);
  EXPECT_EQ(begun.time, 0u);
  EXPECT_EQ(begun.mode, ClockMode::kStepped);
  EXPECT_EQ(begun.rate, 0);
  EXPECT_EQ(begun.owner, 0u);
  EXPECT_EQ(clock.step(7, {20'000, false}), Stepped::kNotYours) << "it has no owner yet";
  EXPECT_TRUE(clock.set(7, {true, ClockMode::kStepped, 0}, kStart + 2h));
  EXPECT_EQ(clock.step(7, {20'000, false}), Stepped::kBegins);
  EXPECT_EQ(clock.state(kStart + 3h).time, 20'000u);
  EXPECT_TRUE(clock.set(7, {true, ClockMode::kRealTime, 1}, kStart + 4h));
  EXPECT_EQ(clock.state(kStart + 4h + 1s).time, 1'020'000u);
}

TEST(Clock, HasOneOwnerAtATime) {
  Clock clock(kStart);
  EXPECT_TRUE(clock.set(7, {true, ClockMode::kScaled, 10}, kStart + 1s));
  EXPECT_FALSE(clock.set(8, {true, ClockMode::kRealTime, 1}, kStart + 2s));
  EXPECT_FALSE(clock.set(8, {false, ClockMode::kRealTime, 1}, kStart + 2s));
  EXPECT_EQ(clock.state(kStart + 3s).owner, 7u);
  EXPECT_EQ(clock.state(kStart + 3s).time, 21'000'000u) << "a second in real time, two at ten times the rate";
  EXPECT_TRUE(clock.set(7, {false, ClockMode::kRealTime, 1}, kStart + 3s));
  EXPECT_EQ(clock.state(kStart + 4s).time, 31'000'000u) << "given back, it goes on as it is";
  EXPECT_TRUE(clock.set(8, {true, ClockMode::kScaled, 0}, kStart + 4s));
  EXPECT_EQ(clock.state(kStart + 100s).time, 31'000'000u);
  EXPECT_TRUE(clock.leave(8, kStart + 100s));
  EXPECT_EQ(clock.owner(), 0u);
}

TEST(Clock, StepsBelongToItsOwner) {
  Clock clock(kStart);
  EXPECT_EQ(clock.step(1, {1000, false}), Stepped::kNotYours);
  ASSERT_TRUE(clock.set(1, {}, kStart));
  EXPECT_EQ(clock.step(1, {1000, false}), Stepped::kNotStepped);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kStepped, 5}, kStart));
  EXPECT_EQ(clock.state(kStart).rate, 0);
  EXPECT_EQ(clock.step(2, {1000, false}), Stepped::kNotYours);
  EXPECT_EQ(clock.step(1, {1000, false}), Stepped::kBegins);
  EXPECT_EQ(clock.step(1, {500, false}), Stepped::kBegins);
  EXPECT_EQ(clock.time(kStart + 1h), 1500u);
  EXPECT_EQ(clock.state(kStart).step, 2u);
}

TEST(Clock, AStepWaitsForThoseWhoFollow) {
  Clock clock(kStart);
  for (std::uint64_t m : {1, 2, 3}) clock.follow(m);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0}, kStart));
  EXPECT_EQ(clock.step(1, {10, true}), Stepped::kBegins);
  EXPECT_EQ(clock.state(kStart).waitsFor, (std::vector<std::uint64_t>{2, 3}));
  EXPECT_EQ(clock.step(1, {10, true}), Stepped::kQueues);
  clock.follow(4);  // comes later: this step does not wait for it, the next one does
  EXPECT_FALSE(clock.done(2, 2)) << "a step that has not begun cannot be done";
  EXPECT_FALSE(clock.done(4, 1));
  EXPECT_FALSE(clock.done(2, 1));
  EXPECT_EQ(clock.time(kStart), 10u);
  EXPECT_TRUE(clock.done(3, 1));
  EXPECT_EQ(clock.time(kStart), 20u);
  EXPECT_EQ(clock.state(kStart).waitsFor, (std::vector<std::uint64_t>{2, 3, 4}));
  EXPECT_FALSE(clock.done(2, 1)) << "an old step";
  EXPECT_TRUE(clock.leave(2, kStart));
  EXPECT_TRUE(clock.leave(3, kStart));
  EXPECT_TRUE(clock.done(4, 2));
  EXPECT_TRUE(clock.state(kStart).waitsFor.empty());
}

TEST(Clock, QueuedStepsAreBoundedAndGoWithTheirOwner) {
  Clock clock(kStart);
  clock.follow(2);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0}, kStart));
  EXPECT_EQ(clock.step(1, {1, true}), Stepped::kBegins);
  for (std::size_t k = 0; k < Clock::kMaxQueuedSteps; ++k) EXPECT_EQ(clock.step(1, {1, true}), Stepped::kQueues);
  EXPECT_EQ(clock.step(1, {1, true}), Stepped::kTooMany);
  EXPECT_TRUE(clock.leave(1, kStart));
  EXPECT_TRUE(clock.done(2, 1));
  EXPECT_EQ(clock.state(kStart).step, 1u);
  EXPECT_EQ(clock.time(kStart), 1u);
}

TEST(Clock, TimeNeverPassesWhatFitsOnTheWire) {
  Clock clock(kStart);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kScaled, 1000}, kStart));
  EXPECT_EQ(clock.time(kStart + std::chrono::hours(24 * 365 * 100)), wire::kMaxTime);
}

// Jumps of an hour, ten minutes long, once left it at its end, where it stood for ever.
TEST(Clock, CanRunHoweverFarItWasMoved) {
  Clock clock(kStart);
  for (const bool jumps : {true, false}) {
    std::uint64_t now = clock.time(kStart), last = 0;
    do {
      last = now;
      ASSERT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0, jumps ? now + wire::kMaxStepTime : 0}, kStart));
      if (!jumps) {
        ASSERT_EQ(clock.step(1, {wire::kMaxStepTime, false}), Stepped::kBegins);
      }
      now = clock.time(kStart);
    } while (now != last);
    EXPECT_LE(now, Clock::kMaxMoved);
    EXPECT_GT(now, Clock::kMaxMoved - wire::kMaxStepTime);
  }
  EXPECT_EQ(clock.time(kStart), Clock::kMaxMoved);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kRealTime, 1}, kStart));
  EXPECT_EQ(clock.time(kStart + 1h), Clock::kMaxMoved + wire::kMaxStepTime);
  ASSERT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0}, kStart + 1h));
  EXPECT_EQ(clock.step(1, {5, false}), Stepped::kBegins);
  EXPECT_EQ(clock.time(kStart + 1h), Clock::kMaxMoved + wire::kMaxStepTime) << "and does not go back";
}

TEST(Clock, IsSetToLaterTimesAlone) {
  Clock clock(kStart);
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kScaled, 2, 60'000'000}, kStart + 1s));
  EXPECT_EQ(clock.time(kStart + 2s), 62'000'000u);
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0, 30'000'000}, kStart + 3s));
  EXPECT_EQ(clock.time(kStart + 9s), 64'000'000u) << "it stands where it was";
  EXPECT_FALSE(clock.set(2, {true, ClockMode::kStepped, 0, 70'000'000}, kStart + 9s));
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0, 70'000'000}, kStart + 9s));
  EXPECT_EQ(clock.time(kStart + 9s), 70'000'000u);
  clock.follow(2);
  EXPECT_EQ(clock.step(1, {10, true}), Stepped::kBegins);
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0, 80'000'000}, kStart + 9s));
  EXPECT_EQ(clock.time(kStart + 9s), 70'000'010u) << "not while a step waits";
}

TEST(Clock, OfARecordingStandsAtItsEnd) {
  Clock clock(kStart);
  wire::Clock recording;
  recording.mode = ClockMode::kScaled;
  recording.rate = 4;
  recording.time = 10'000'000;
  recording.end = 20'000'000;
  clock.play(recording, kStart + 5s);
  EXPECT_EQ(clock.state(kStart + 5s).end, 20'000'000u);
  EXPECT_EQ(clock.time(kStart + 6s), 14'000'000u);
  EXPECT_EQ(clock.time(kStart + 1h), 20'000'000u);
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kStepped, 0, 15'000'000}, kStart + 6s));
  EXPECT_EQ(clock.time(kStart + 1h), 15'000'000u);
  EXPECT_EQ(clock.step(1, {90'000'000, false}), Stepped::kBegins);
  EXPECT_EQ(clock.time(kStart + 1h), 20'000'000u);
  EXPECT_TRUE(clock.set(1, {true, ClockMode::kRealTime, 1, 25'000'000}, kStart + 2h));
  EXPECT_EQ(clock.time(kStart + 3h), 20'000'000u);
}

// Whatever is said in whatever order: the clock never goes back, and no step begins while somebody waits.
TEST(Clock, LawsHoldForRandomConversations) {
  std::mt19937 random(5);
  for (int round = 0; round < 200; ++round) {
    Clock clock(kStart);
    Clock::Instant now = kStart;
    std::uint64_t lastTime = 0, lastStep = 0;
    for (int k = 0; k < 300; ++k) {
      now += std::chrono::microseconds(random() % 5000);
      const std::uint64_t member = 1 + random() % 4;
      const auto waitedFor = clock.state(now).waitsFor;
      const auto stepBefore = clock.state(now).step;
      bool mayGoOn = waitedFor.empty();
      switch (random() % 8) {
        case 0:
          mayGoOn = mayGoOn || clock.owner() == member || clock.owner() == 0;
          clock.set(member,
                    {random() % 5 != 0, static_cast<ClockMode>(random() % 3), static_cast<double>(random() % 3), random() % 1'000'000},
                    now);
          break;
        case 1:
          clock.follow(member);
          break;
        case 2:
          mayGoOn = mayGoOn || waitedFor == std::vector{member};
          clock.leave(member, now);
          break;
        case 3:
        case 4:
          mayGoOn = mayGoOn || waitedFor == std::vector{member};
          clock.done(member, clock.state(now).step);
          break;
        default:
          clock.step(member, {1 + random() % 1000, random() % 3 != 0});
      }
      const wire::Clock state = clock.state(now);
      ASSERT_GE(state.time, lastTime);
      ASSERT_GE(state.step, lastStep);
      ASSERT_TRUE(mayGoOn || state.step == stepBefore) << "a step began while somebody was waited for";
      lastTime = state.time;
      lastStep = state.step;
    }
  }
}

}  // namespace
}  // namespace ridgecast::clock
