// The control of the session's clock, without a window or a page: what is shown, and what buttons and keys ask for.
#include "client/core/hands/clock_bar.h"

#include <gtest/gtest.h>

namespace ridgecast::core {
namespace {

using wire::ClockMode;

TEST(ClockBar, TimesReadAsOnAPlayer) {
  EXPECT_EQ(clockText(0), "0:00.0");
  EXPECT_EQ(clockText(62'399'999), "1:02.3");
  EXPECT_EQ(clockText(3'600'000'000 - 1), "59:59.9");
  EXPECT_EQ(clockText(3'602'300'000), "1:00:02.3");
  EXPECT_EQ(rateText(0.25), "0.25 x");
  EXPECT_EQ(rateText(16), "16 x");
}

TEST(ClockBar, PausesAndGoesOnAsFastAsBefore) {
  ClockBar clock;
  clock.rate = 4;
  EXPECT_EQ(toggled(clock).mode, ClockMode::kStepped);
  clock.runs = false;
  EXPECT_EQ(toggled(clock).mode, ClockMode::kScaled);
  EXPECT_EQ(toggled(clock).rate, 4);
  clock.rate = 1;
  EXPECT_EQ(toggled(clock).mode, ClockMode::kRealTime);
  EXPECT_EQ(toggled(clock).time, 0u);
  clock.time = clock.end = 5'000'000;
  EXPECT_EQ(toggled(clock).time, 1u) << "over: from the beginning";
  clock.runs = true;
  EXPECT_EQ(toggled(clock).mode, ClockMode::kRealTime);
}

TEST(ClockBar, SpeedHasItsBoundsAndAPauseStaysOne) {
  ClockBar clock;
  for (const double rate : {2.0, 4.0, 8.0, 16.0, 16.0}) EXPECT_EQ(clock.rate = faster(clock, true).rate, rate);
  for (const double rate : {8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.25}) EXPECT_EQ(clock.rate = faster(clock, false).rate, rate);
  clock.runs = false;
  EXPECT_EQ(faster(clock, true).mode, ClockMode::kStepped);
}

TEST(ClockBar, MovesWithinARecordingAndAheadInAWorld) {
  ClockBar clock;
  clock.time = 8'000'000;
  EXPECT_EQ(movedBy(clock, kClockSkip).time, 18'000'000u);
  EXPECT_EQ(movedBy(clock, -kClockSkip).time, 1u) << "0 would be no jump";
  clock.end = 15'000'000;
  EXPECT_EQ(movedBy(clock, kClockSkip).time, 15'000'000u);
  EXPECT_EQ(movedTo(clock, 3'000'000).time, 3'000'000u);
  EXPECT_TRUE(movedTo(clock, 0).own);
  EXPECT_EQ(movedTo(clock, 0).mode, ClockMode::kRealTime) << "it goes on as it was";
}

TEST(ClockBar, IsWhatTheServerSaysOnceItHasHeardWhatWasSet) {
  const SessionClock::Instant begin{};
  const auto told = [&](const wire::Clock& said, SessionClock clock) {
    clock.hear(said, begin);
    return clock;
  };
  const wire::World world{.camera = 3, .revision = 6};
  ClockBar bar;
  EXPECT_NE(bar.refusal(toggled(bar)), "") << "no clock is known";
  SessionClock clock = told({.rate = 0, .time = 5'000'000, .owner = 3}, {});
  bar.hear(clock, world, {}, begin);
  EXPECT_FALSE(bar.on) << "no recording";
  EXPECT_FALSE(bar.runs);
  EXPECT_EQ(bar.time, 5'000'000u);
  EXPECT_EQ(bar.driver, "") << "oneself";
  const wire::SetClock set = movedTo(bar, 9'000'000);
  EXPECT_EQ(bar.refusal(set), "");
  bar.goOn(set);
  clock.set();
  clock = told({.rate = 0, .time = 5'100'000, .owner = 3}, clock);
  bar.hear(clock, world, {}, begin);
  EXPECT_EQ(bar.time, 9'000'000u) << "what the server said before it heard of it";
}

TEST(ClockBar, NamesWhoElseHasIt) {
  const SessionClock::Instant begin{};
  SessionClock clock;
  clock.hear({.rate = 1, .time = 1, .owner = 4, .end = 9}, begin);
  ClockBar bar;
  bar.hear(clock, {.camera = 3, .revision = 5}, {}, begin);
  EXPECT_TRUE(bar.on) << "a recording";
  EXPECT_EQ(bar.refusal(toggled(bar)), "Member 4 owns the clock.");
  bar.hear(clock, {.camera = 3, .revision = 5}, {{4, {{.camera = 4, .name = "Ada"}, begin}}}, begin);
  EXPECT_EQ(bar.refusal(toggled(bar)), "Ada owns the clock.");
  bar.hear(clock, {.camera = 4, .revision = 5}, {}, begin);
  EXPECT_EQ(bar.refusal(toggled(bar)), "");
  EXPECT_NE(bar.refusal(movedTo(bar, 5)).find("too old"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::core
