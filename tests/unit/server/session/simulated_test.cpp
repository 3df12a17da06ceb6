// Presence and the directory under a simulated timer: hours in milliseconds, exact to the tick.
#include <gtest/gtest.h>

#include <chrono>
#include <vector>

#include "scripted.h"
#include "server/session/presence.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;
using testing_support::SimulatedTimer;

struct Watcher final : Sender {
  explicit Watcher(const Timer& t) : timer(t) {}
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    if (const auto* members = std::get_if<wire::Members>(&message)) {
      times.push_back(timer.now());
      for (const wire::Moved& moved : members->moved) last = moved.pose.sequence;
    }
    if (const auto* clock = std::get_if<wire::Clock>(&message)) clocks.push_back(*clock);
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override { ADD_FAILURE(); }

  const Timer& timer;
  std::vector<Timer::Time> times;
  std::vector<wire::Clock> clocks;
  std::uint64_t last = 0;
};

TEST(Simulated, AMemberIsNotifiedTwentyTimesASecondAndOfTheLastPose) {
  SimulatedTimer timer;
  const auto presence = std::make_shared<Presence>(timer);
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
  for (std::size_t k = 1; k < watcher->times.size(); ++k) EXPECT_GE(watcher->times[k] - watcher->times[k - 1], Presence::kLeastPause);
  EXPECT_EQ(watcher->last, kPoses);
  EXPECT_TRUE(other->times.empty());
  EXPECT_EQ(timer.pending(), 0u) << "nothing runs while nothing changes";
}

TEST(Simulated, TheClockIsTheTimers) {
  SimulatedTimer timer;
  const auto presence = std::make_shared<Presence>(timer);
  const auto watcher = std::make_shared<Watcher>(timer);
  presence->join(1, {}, watcher, {});
  timer.advance(36h);
  presence->receive(1, wire::AskClock{7});
  ASSERT_EQ(watcher->clocks.size(), 1u);
  EXPECT_EQ(watcher->clocks[0].time, std::uint64_t{36} * 3600 * 1'000'000);
  EXPECT_EQ(watcher->clocks[0].echo, 7u);
}

TEST(Simulated, SessionsEndWhenTheyWereEmptyForLongEnough) {
  auto resources = std::make_shared<Resources>();
  auto owned = std::make_unique<SimulatedTimer>();
  SimulatedTimer& timer = *owned;
  resources->timer = std::move(owned);
  resources->limits.sessionIdle = 1h;
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  const auto visited = directory->add("visited", flatTerrain(7)).value();
  ASSERT_TRUE(directory->add("empty", flatTerrain(8)));
  {
    const auto place = visited->enter();
    timer.advance(3h);
    EXPECT_EQ(directory->find("empty"), nullptr);
    EXPECT_EQ(directory->find("visited"), visited);
  }
  timer.advance(1h);
  EXPECT_EQ(directory->find("visited"), visited) << "an hour has not passed since it was seen to be empty";
  timer.advance(1h);
  EXPECT_EQ(directory->find("visited"), nullptr);
  EXPECT_NE(directory->find(kDefaultName), nullptr);
}

}  // namespace
}  // namespace ridgecast::session
