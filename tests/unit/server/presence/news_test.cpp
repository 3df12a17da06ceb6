// What a member is told of the others.
#include "server/presence/news.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>

#include "server/presence/presence.h"
#include "tests/support/sanitized.h"
#include "tests/support/simulated_timer.h"
#include "tests/unit/server/presence/listener.h"

namespace ridgecast::presence {
namespace {

using namespace std::chrono_literals;
using testing_support::SimulatedTimer;

struct World {
  SimulatedTimer timer;
  std::shared_ptr<clock::SessionClock> clock = std::make_shared<clock::SessionClock>(timer);
  std::shared_ptr<Presence> presence = std::make_shared<Presence>(timer, clock);
  std::map<std::uint64_t, wire::Member> all;
  std::uint64_t sequence = 0;

  std::shared_ptr<Listener> join(std::uint64_t camera, std::uint32_t near, bool members = true, bool states = false) {
    auto listener = std::make_shared<Listener>(timer);
    wire::Hello hello;
    hello.members = members;
    hello.near = near;
    hello.states = states;
    presence->join(camera, hello, listener, {});
    all[camera].camera = camera;
    return listener;
  }
  void move(std::uint64_t camera, lattice::Step x, lattice::Step z, std::size_t state = 0) {
    const auto pose = poseAt(x, z, 1, ++sequence, state);
    presence->receive(camera, pose);
    all[camera].moved = wire::Moved{camera, pose, presence->state().clock.time};
  }
  void leave(std::uint64_t camera) {
    presence->leave(camera);
    all.erase(camera);
  }
  std::set<std::uint64_t> nearest(std::uint64_t self, std::size_t count) const {
    auto order = sorted(all, self);
    order.resize(std::min(order.size(), count));
    return {order.begin(), order.end()};
  }
};

TEST(News, FewMembersAreAllToldTwentyTimesASecondWhateverIsAskedFor) {
  for (const std::uint32_t near : {0u, 24u}) {
    World w;
    const auto watcher = w.join(1, near);
    for (std::uint64_t k = 2; k <= 20; ++k) w.join(k, 24, false);
    for (int round = 0; round < 400; ++round) {
      for (std::uint64_t k = 2; k <= 20; ++k) w.move(k, round * 1000, 0);
      w.timer.advance(5ms);
    }
    w.timer.advance(100ms);
    EXPECT_EQ(watcher->table.size(), 19u);
    for (const auto& [camera, member] : watcher->table) {
      EXPECT_EQ(member.moved, w.all[camera].moved);
      EXPECT_NEAR(static_cast<double>(watcher->told[camera].size()), 40, 2);
    }
    EXPECT_EQ(w.timer.pending(), 0u) << "nothing is to be told";
    EXPECT_EQ(watcher->others, near == 0 ? 0u : 19u);
  }
}

TEST(News, ManyAreToldByNearnessWithinTheBytes) {
  std::mt19937_64 random(3);
  World w;
  constexpr std::uint64_t kMembers = testing_support::kSanitized ? 250 : 600;
  const auto near = w.join(1, 24, true, true), blind = w.join(2, 24), old = w.join(3, 0), three = w.join(4, 3);
  for (std::uint64_t k = 5; k <= kMembers; ++k) w.join(k, 24, false);
  const auto walk = [&](std::uint64_t k) {
    const auto& pose = w.all[k].moved->pose.camera.pose;
    w.move(k, pose.x + static_cast<lattice::Step>(random() % 257) - 128, pose.z + static_cast<lattice::Step>(random() % 257) - 128, 256);
  };
  for (std::uint64_t k = 1; k <= kMembers; ++k) w.move(k, coordinate(2, random), coordinate(2, random));
  w.timer.advance(60s);  // all are named that ever will be
  const auto before = w.timer.now();
  for (const auto& l : {near, blind, old, three}) l->bytes = l->messages = 0, l->told.clear();
  for (int round = 0; round < 100; ++round) {
    for (std::uint64_t k = 1; k <= kMembers; ++k) walk(k);
    w.timer.advance(100ms);
  }
  const double seconds = std::chrono::duration<double>(w.timer.now() - before).count();
  for (const auto& l : {near, blind, old, three}) EXPECT_LE(static_cast<double>(l->bytes) / seconds, 80'000);
  for (const auto& l : {near, blind, three}) {
    EXPECT_EQ(l->others, kMembers - 1);
    EXPECT_GE(l->table.size(), 64u);
    EXPECT_LE(l->table.size(), 96u + 24);
    std::uint32_t counted = 0;
    for (const std::uint32_t count : l->crowd.count) counted += count;
    EXPECT_EQ(counted, kMembers);
  }
  EXPECT_EQ(old->table.size(), kMembers - 1) << "a client that knows no crowds is told of each";
  EXPECT_TRUE(old->crowd.count.empty() && old->others == 0);
  // Those that stayed near the whole time: as often as they moved, but for the bytes; the others seldom.
  const auto rate = [&](const Listener& l, std::uint64_t camera) {
    const auto it = l.told.find(camera);
    return it == l.told.end() ? 0.0 : static_cast<double>(it->second.size()) / seconds;
  };
  for (const std::uint64_t camera : w.nearest(2, 12)) EXPECT_GT(rate(*blind, camera), 9) << camera;
  for (const std::uint64_t camera : w.nearest(1, 12)) EXPECT_GT(rate(*near, camera), 8) << camera;
  for (const std::uint64_t camera : w.nearest(3, 12)) EXPECT_GT(rate(*old, camera), 6) << camera;
  for (const std::uint64_t camera : w.nearest(4, 2)) EXPECT_GT(rate(*three, camera), 9) << camera;
  const auto order = sorted(w.all, 2);
  for (std::size_t k = 40; k < 60; ++k) {
    EXPECT_GT(rate(*blind, order[k]), 0.7) << k;
    EXPECT_LT(rate(*blind, order[k]), 2) << k;
  }
  for (const auto& [camera, member] : near->table) EXPECT_EQ(member.moved->pose.state.size(), 256u);
  for (const auto& [camera, member] : blind->table) EXPECT_TRUE(member.moved->pose.state.empty());
  // At rest everybody knows what it should, to the last move.
  w.timer.advance(10s);
  for (const auto& [l, self] : std::vector<std::pair<std::shared_ptr<Listener>, std::uint64_t>>{{near, 1}, {old, 3}, {three, 4}}) {
    for (const auto& [camera, member] : l->table) {
      auto expected = *w.all[camera].moved;
      if (self == 4) expected.pose.state.clear();
      EXPECT_EQ(*member.moved, expected);
    }
    for (const std::uint64_t camera : w.nearest(self, 64)) EXPECT_TRUE(l->table.contains(camera));
  }
  w.timer.advance(10s);
  EXPECT_EQ(w.timer.pending(), 0u) << "nothing is to be told";
  Crowd crowd;
  for (const auto& [camera, member] : w.all) crowd.add(member);
  for (const auto& l : {near, blind, three}) EXPECT_EQ(l->crowd, crowd.counts(512)) << "no earlier one";
}

// Joins, leaves, teleports, members without a place, slow readers: the tables are right whenever there is rest.
TEST(News, AtRestEverybodyKnowsTheNearest) {
  for (int world = 0; world < 5; ++world) {
    std::mt19937_64 random(static_cast<std::uint64_t>(world) + 11);
    World w;
    std::map<std::uint64_t, std::shared_ptr<Listener>> listeners;
    std::map<std::uint64_t, std::uint32_t> near;
    std::uint64_t last = 0;
    for (int round = 0; round < 1500; ++round) {
      const auto any = [&] { return std::next(w.all.begin(), static_cast<std::ptrdiff_t>(random() % w.all.size()))->first; };
      const auto what = random() % 10;
      if (w.all.size() < 40 || (what == 0 && w.all.size() < 200)) {
        near[++last] = static_cast<std::uint32_t>(random() % 3 * 12);
        listeners[last] = w.join(last, near[last], random() % 2 == 0);
      } else if (what == 1) {
        const auto camera = any();
        w.leave(camera);
        listeners.erase(camera);
      } else if (what == 2) {
        const auto camera = any();
        listeners[camera]->isSlow ? listeners[camera]->readOn() : void(listeners[camera]->isSlow = true);
      } else {
        w.move(any(), coordinate(world, random), coordinate(world, random), random() % 2 * 100);
      }
      w.timer.advance(std::chrono::milliseconds(random() % 20));
      if (round % 500 != 499) continue;
      for (const auto& [camera, listener] : listeners) listener->readOn();
      w.timer.advance(60s);
      EXPECT_EQ(w.timer.pending(), 0u);
      for (const auto& [camera, listener] : listeners) {
        if (listener->messages == 0) continue;
        for (const std::uint64_t other : w.nearest(camera, near[camera] == 0 ? 1000 : 64))
          ASSERT_TRUE(listener->table.contains(other)) << "world " << world << ": " << camera << " does not know " << other;
        for (const auto& [other, member] : listener->table) {
          auto expected = w.all.at(other).moved;
          if (near[camera] != 0 && expected) expected->pose.state.clear();
          ASSERT_EQ(member.moved, expected);
        }
        if (near[camera] != 0) {
          ASSERT_EQ(listener->others, w.all.size() - 1);
        }
        for (const std::uint64_t gone : listener->left) ASSERT_FALSE(w.all.contains(gone)) << "who fades has not left";
      }
    }
  }
}

TEST(News, AnotherCameraComesNearAtOnceWhereverItWas) {
  World w;
  const auto watcher = w.join(1, 24);
  for (std::uint64_t k = 2; k <= 400; ++k) w.join(k, 24, false);
  for (std::uint64_t k = 1; k <= 400; ++k) w.move(k, static_cast<lattice::Step>(k) * 65'536, 0);
  w.timer.advance(10s);
  EXPECT_FALSE(watcher->table.contains(400));
  w.move(400, 65'537, 0);
  w.timer.advance(100ms);
  ASSERT_TRUE(watcher->table.contains(400));
  EXPECT_EQ(watcher->table[400].moved, w.all[400].moved);
  w.leave(400);
  w.leave(399);
  w.timer.advance(1100ms);
  EXPECT_EQ(watcher->left, std::set<std::uint64_t>{400}) << "nobody is told that one left whom it did not know";
  EXPECT_EQ(watcher->others, 397u);
}

TEST(News, ASteppedSessionIsToldOfEverybodyAtOnce) {
  World w;
  const auto owner = w.join(1, 0), modest = w.join(2, 24);
  constexpr std::uint64_t kMembers = testing_support::kSanitized ? 150 : 500;
  for (std::uint64_t k = 3; k <= kMembers; ++k) w.join(k, 24, false);
  w.clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
  w.timer.advance(1s);
  for (int round = 0; round < 20; ++round) {
    for (std::uint64_t k = 3; k <= kMembers; ++k) w.move(k, round, static_cast<lattice::Step>(k), 256);
    w.timer.advance(50ms);
    for (std::uint64_t k = 3; k <= kMembers; ++k) ASSERT_EQ(owner->table[k].moved, w.all[k].moved);
  }
  EXPECT_LE(modest->table.size(), 120u);
}

}  // namespace
}  // namespace ridgecast::presence
