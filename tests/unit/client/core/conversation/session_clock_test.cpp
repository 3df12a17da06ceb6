#include "client/core/conversation/session_clock.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "client/core/conversation/roster.h"

namespace ridgecast::core {
namespace {

using namespace std::chrono_literals;
using Instant = SessionClock::Instant;

wire::Clock running(std::uint64_t time, std::uint64_t echo = 0, double rate = 1) {
  wire::Clock c;
  c.mode = rate == 1 ? wire::ClockMode::kRealTime : wire::ClockMode::kScaled;
  c.rate = rate;
  c.time = time;
  c.echo = echo;
  return c;
}

TEST(SessionClock, KeepsTheLastSentenceAboutIt) {
  SessionClock clock;
  wire::Clock said = running(1);
  said.notice = "The clock belongs to member 1.";
  clock.hear(said, Instant{1h});
  clock.hear(running(2), Instant{1h});
  EXPECT_EQ(clock.notice(), said.notice);
}

TEST(SessionClock, IsSettledOnceTheServerAnswersAQuestionAskedAfterAllThatWasSet) {
  SessionClock clock;
  EXPECT_TRUE(clock.isSettled());
  const auto before = clock.ask(Instant{1h});
  clock.set();
  clock.set();
  EXPECT_FALSE(clock.isSettled()) << "they wait to leave";
  clock.setLeft();
  const auto between = clock.ask(Instant{1h});
  clock.setLeft();
  for (const std::uint64_t older : {std::uint64_t{0}, before.echo, between.echo}) {
    clock.hear(running(1, older), Instant{1h});
    EXPECT_FALSE(clock.isSettled());
  }
  const auto after = clock.ask(Instant{1h});
  clock.hear(running(2, between.echo), Instant{1h});
  EXPECT_FALSE(clock.isSettled());
  clock.hear(running(2, after.echo), Instant{1h});
  EXPECT_TRUE(clock.isSettled());
}

TEST(SessionClock, IsGoodToHalfARoundTrip) {
  // Random delays either way: what it says differs from the truth by no more than it says it may.
  std::mt19937 random(3);
  for (double rate : {1.0, 0.25, 20.0}) {
    SessionClock clock;
    Instant now{1h};
    const auto truth = [&](Instant at) { return std::chrono::duration<double, std::micro>(at - Instant{1h}).count() * rate + 5e6; };
    for (int k = 0; k < 500; ++k) {
      const auto question = clock.ask(now);
      now += std::chrono::microseconds(50 + random() % 3000);
      const auto answer = running(static_cast<std::uint64_t>(truth(now)), question.echo, rate);
      now += std::chrono::microseconds(50 + random() % 3000);
      clock.hear(answer, now);
      now += std::chrono::microseconds(random() % 100'000);
      const double off = std::abs(static_cast<double>(clock.time(now)) - truth(now));
      ASSERT_LE(off, static_cast<double>(clock.uncertainty(now).count()) + 2) << k;
    }
    EXPECT_LT(clock.uncertainty(now).count(), 1500 * std::max(1.0, rate)) << "the best of many counts";
  }
}

TEST(SessionClock, OfARecordingStandsAtItsEnd) {
  SessionClock clock;
  wire::Clock said = running(9'000'000);
  said.end = 10'000'000;
  clock.hear(said, Instant{1h});
  EXPECT_NEAR(static_cast<double>(clock.time(Instant{1h} + 500ms)), 9.5e6, 1e3);
  EXPECT_EQ(clock.time(Instant{2h}), 10'000'000u);
}

TEST(SessionClock, AChangeOfRateIsFollowedAtOnce) {
  SessionClock clock;
  Instant now{};
  const auto question = clock.ask(now);
  clock.hear(running(1'000'000, question.echo), now + 1ms);
  EXPECT_NEAR(static_cast<double>(clock.time(now + 1s)), 2e6, 2000);
  clock.hear(running(3'000'000, 0, 0.0), now + 2s);
  EXPECT_NEAR(static_cast<double>(clock.time(now + 9s)), 3e6, 2000);
  clock.hear(running(3'000'000, 0, 10.0), now + 9s);
  EXPECT_NEAR(static_cast<double>(clock.time(now + 10s)), 13e6, 20'000);
  // Also where a sample of before could still be right.
  const auto next = clock.ask(now + 20s);
  clock.hear(running(1'000'000, next.echo), now + 20s + 1ms);
  clock.hear(running(1'500'000, 0, 4.0), now + 20s + 500ms);
  EXPECT_NEAR(static_cast<double>(clock.time(now + 20s + 600ms)), 1.9e6, 10'000);
}

TEST(SessionClock, AStepIsExact) {
  SessionClock clock;
  EXPECT_EQ(clock.version(), 0u);
  wire::Clock stepped;
  stepped.mode = wire::ClockMode::kStepped;
  stepped.rate = 0;
  stepped.time = 12'345;
  stepped.step = 3;
  stepped.waitsFor = {4, 9};
  clock.hear(stepped, Instant{5s});
  EXPECT_EQ(clock.time(Instant{500s}), 12'345u);
  EXPECT_EQ(clock.uncertainty(Instant{500s}).count(), 0);
  EXPECT_TRUE(clock.waitsFor(9));
  EXPECT_FALSE(clock.waitsFor(5));
}

TEST(Roster, KnowsHowManyThereAreNamedOrNot) {
  Roster roster;
  const Instant now{};
  ASSERT_TRUE(roster.apply({{{3, wire::Role::kViewer, "", {}}, {4, wire::Role::kViewer, "", {}}}, {}, {}}, now));
  EXPECT_EQ(roster.count(), 2u) << "a server that knows no crowds names all";
  ASSERT_TRUE(roster.apply({{}, {}, {}, 2000, {4}, wire::Crowd{1, {5}, {6}, {1998}}}, now));
  EXPECT_EQ(roster.count(), 2000u);
  EXPECT_EQ(roster.others().size(), 1u);
  EXPECT_EQ(roster.crowd().count, std::vector<std::uint32_t>{1998});
  EXPECT_FALSE(roster.apply({{}, {}, {}, 7, {4}}, now)) << "4 has faded before";
  EXPECT_EQ(roster.count(), 2000u);
  ASSERT_TRUE(roster.apply({{}, {}, {}, 1, {}}, now));
  EXPECT_EQ(roster.crowd().i, std::vector<std::int64_t>{5}) << "as last told";
  ASSERT_TRUE(roster.apply({{}, {}, {}, 1, {}, wire::Crowd{}}, now));
  EXPECT_TRUE(roster.crowd().count.empty());
}

TEST(Roster, RefusesWhatCannotBeAndKeepsWhatItHad) {
  Roster roster;
  const Instant now{};
  wire::Members news;
  news.joined = {{1, wire::Role::kViewer, "a", {}}, {2, wire::Role::kSensor, "b", {}}};
  ASSERT_TRUE(roster.apply(news, now));
  EXPECT_EQ(roster.version(), 1u);
  EXPECT_FALSE(roster.apply(news, now)) << "nobody joins twice";
  news = {};
  news.left = {2};
  news.moved = {{3, {}, 0}};
  EXPECT_FALSE(roster.apply(news, now)) << "3 has not joined";
  EXPECT_EQ(roster.others().size(), 2u);
  news.moved = {{1, {5, {}}, 7}};
  ASSERT_TRUE(roster.apply(news, now + 1s));
  ASSERT_EQ(roster.others().size(), 1u);
  EXPECT_EQ(roster.others().at(1).member.moved->pose.sequence, 5u);
  EXPECT_EQ(roster.others().at(1).heard, now + 1s);
  EXPECT_FALSE(roster.apply(news, now)) << "2 has left already";
}

}  // namespace
}  // namespace ridgecast::core
