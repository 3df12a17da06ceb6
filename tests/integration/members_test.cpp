// Eight members of one session, two of them sensors, over loopback: each sees the others, their clocks agree, and a stepped clock waits for
// everybody. RIDGECAST_MEMBERS_SECONDS makes it longer than a few seconds; MEASURE=1, on a machine that does nothing else, says how soon
// and how closely.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "client/link/connection.h"
#include "common/wire/wire.h"
#include "tests/integration/loopback.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using link::Connection;
using Time = std::chrono::steady_clock;
using testing_support::kTimeout;

double seconds() {
  const char* given = std::getenv("RIDGECAST_MEMBERS_SECONDS");
  return given ? std::atof(given) : 4;
}

wire::Hello helloOf(const std::string& name, wire::Role role = wire::Role::kViewer) {
  wire::Hello hello;
  hello.clientName = name;
  hello.role = role;
  hello.members = hello.clock = true;
  hello.settings.threshold = 20;
  hello.settings.triangleBudget = 20'000;
  return hello;
}

wire::PoseMessage poseAt(std::uint64_t sequence) {
  wire::PoseMessage pose;
  pose.sequence = sequence;
  pose.camera.pose = {
      .x = 1'000 * static_cast<lattice::Step>(sequence), .z = 0, .remainderX = 0, .remainderZ = 0, .y = 1500, .yaw = 0, .pitch = 0};
  pose.camera.projection.width = 160;
  pose.camera.projection.height = 90;
  return pose;
}

class MembersTest : public LoopbackTest {
 protected:
  void SetUp() override {
    open([](const session::WorldSpec& spec, const std::stop_token&) { return terrain::create(spec.terrain, spec.seed); });
    listen();
  }
  std::unique_ptr<Connection> join(const wire::Hello& hello, const std::string& session = "default") {
    const std::string url = "127.0.0.1:" + std::to_string(server->port()) + "?session=" + session;
    auto opened = Connection::open(core::parseUrl(url).value(), hello, {.reconnects = false, .timeout = kTimeout});
    if (!opened) throw std::runtime_error(opened.error().message);
    return std::move(*opened);
  }
};

TEST_F(MembersTest, EightMembersSeeEachOtherInTimeAndTheirClocksAgree) {
  constexpr std::size_t kMembers = 8;
  std::vector<std::unique_ptr<Connection>> members;
  for (std::size_t k = 0; k < kMembers; ++k)
    members.push_back(join(helloOf("member " + std::to_string(k), k < 2 ? wire::Role::kSensor : wire::Role::kViewer)));
  std::vector<std::uint64_t> camera;
  for (const auto& m : members) camera.push_back(m->world().camera);

  // sentAt[k][s]: when member k sent its pose s. Written before the pose is sent, read after it was received.
  const auto span = std::chrono::duration<double>(seconds());
  const auto poses = static_cast<std::size_t>(span / 40ms) + 10;
  std::vector<std::vector<std::atomic<std::int64_t>>> sentAt(kMembers);
  for (auto& s : sentAt) s = std::vector<std::atomic<std::int64_t>>(poses + 2);
  std::atomic<bool> ends{false};
  std::mutex mutex;
  std::vector<double> ages;  // milliseconds: how old is what is seen of somebody, now
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < kMembers; ++k) {
    threads.emplace_back([&, k] {
      Connection& me = *members[k];
      std::vector<double> mine;
      auto next = Time::now();
      core::Roster roster;
      for (std::uint64_t s = 1; s <= poses && !ends; ++s) {
        sentAt[k][s] = Time::now().time_since_epoch().count();
        me.send(poseAt(s));
        next += 40ms;
        while (Time::now() < next) {
          if (auto received = me.receive(5ms)) me.acknowledge({received->iteration.number, received->iteration.meshHash});
          if (auto news = me.others(roster.version())) roster = std::move(*news);
          // How old is the view of each: since when has the member been elsewhere than it is seen?
          const auto now = Time::now().time_since_epoch().count();
          for (std::size_t other = 0; other < kMembers; ++other) {
            const auto it = roster.others().find(camera[other]);
            if (other == k || it == roster.others().end() || !it->second.member.moved) continue;
            const std::uint64_t seen = it->second.member.moved->pose.sequence;
            if (seen + 1 >= sentAt[other].size()) continue;
            const std::int64_t left = sentAt[other][seen + 1];
            mine.push_back(left == 0 ? 0 : std::max(0.0, static_cast<double>(now - left) / 1e6));
          }
        }
      }
      const std::lock_guard lock(mutex);
      ages.insert(ages.end(), mine.begin(), mine.end());
    });
  }
  // Meanwhile: what do they think what time it is?
  std::vector<double> apart;
  const auto until = Time::now() + std::chrono::duration_cast<Time::duration>(span);
  std::this_thread::sleep_for(500ms);
  while (Time::now() < until) {
    std::int64_t least = std::numeric_limits<std::int64_t>::max(), most = std::numeric_limits<std::int64_t>::min();
    for (const auto& m : members) {
      const auto clock = m->clock();
      const auto now = Time::now();
      // Against the machine's own clock, as not all can be asked at once.
      const auto off = static_cast<std::int64_t>(clock.time(now)) -
                       std::chrono::duration_cast<std::chrono::microseconds>(now.time_since_epoch()).count();
      least = std::min(least, off);
      most = std::max(most, off);
    }
    apart.push_back(static_cast<double>(most - least) / 1e3);
    std::this_thread::sleep_for(10ms);
  }
  ends = true;
  for (auto& t : threads) t.join();
  for (const auto& m : members) {
    ASSERT_FALSE(m->error()) << m->error()->message;
    EXPECT_TRUE(testing_support::await([&] { return m->others() && m->others()->others().size() == kMembers - 1; }));
    const auto others = m->others();
    ASSERT_TRUE(others);
    std::size_t sensors = 0;
    for (const auto& [id, other] : others->others()) sensors += other.member.role == wire::Role::kSensor;
    EXPECT_GE(sensors, 1u);
  }
  ASSERT_FALSE(ages.empty());
  std::sort(ages.begin(), ages.end());
  std::sort(apart.begin(), apart.end());
  const double p99 = ages[ages.size() * 99 / 100];
  std::printf("views of others: median %.1f ms, p99 %.1f ms, most %.1f ms; clocks apart: median %.2f ms, most %.2f ms\n",
              ages[ages.size() / 2], p99, ages.back(), apart[apart.size() / 2], apart.back());
  RecordProperty("p99_ms", std::to_string(p99));
  if (testing_support::measures()) {
    EXPECT_LE(p99, 100);
    EXPECT_LE(apart[apart.size() * 99 / 100], 10);
  }
}

TEST_F(MembersTest, AWaitingStepNeverRunsAheadOfAMember) {
  auto owner = join(helloOf("owner"));
  owner->setClock({true, wire::ClockMode::kStepped, 0});
  while (owner->clock().said().owner != owner->world().camera) ASSERT_TRUE(owner->waitForClock(owner->clock().version(), kTimeout));

  const std::uint64_t begin = owner->clock().said().time;
  constexpr std::size_t kOthers = 7;
  constexpr std::uint64_t kSteps = 60;
  std::vector<std::unique_ptr<Connection>> others;
  for (std::size_t k = 0; k < kOthers; ++k) others.push_back(join(helloOf("other", k < 2 ? wire::Role::kSensor : wire::Role::kViewer)));
  for (auto& o : others) ASSERT_TRUE(o->waitForClock(0, kTimeout));

  std::array<std::atomic<std::uint64_t>, kOthers> done{};  // steps that each has finished its work for
  std::atomic<bool> ranAhead{false};
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < kOthers; ++k)
    threads.emplace_back([&, k] {
      Connection& me = *others[k];
      std::uint64_t version = 0;
      while (done[k] < kSteps && me.waitForClock(version, kTimeout)) {
        const auto clock = me.clock();
        version = clock.version();
        const auto& said = clock.said();
        for (const auto& d : done)
          if (said.step > d + 1) ranAhead = true;  // the step before is not done by somebody
        if (said.time != begin + said.step * 20'000) ranAhead = true;
        if (!clock.waitsFor(me.world().camera) || said.step == done[k]) continue;
        if ((said.step + k) % 9 == 0) std::this_thread::sleep_for(2ms);  // its work
        done[k] = said.step;
        me.stepDone({said.step});
      }
    });
  for (std::uint64_t s = 0; s < kSteps; ++s) owner->step({20'000, true});  // queued, as far as they do not wait
  for (auto& t : threads) t.join();
  for (const auto& d : done) EXPECT_EQ(d, kSteps);
  EXPECT_FALSE(ranAhead);
  EXPECT_FALSE(owner->error());
}

TEST_F(MembersTest, NoRealTimePassesInASessionThatBeginsStepped) {
  const std::string lab = "lab&terrain=canyon&clock=stepped";
  auto first = join(helloOf("first"), lab);
  std::this_thread::sleep_for(50ms);
  auto second = join(helloOf("second"), lab);
  for (const auto* member : {first.get(), second.get()}) {
    ASSERT_TRUE(member->waitForClock(0, kTimeout));
    EXPECT_EQ(member->clock().said().mode, wire::ClockMode::kStepped);
    EXPECT_EQ(member->clock().said().time, 0u);
    EXPECT_EQ(member->clock().said().owner, 0u);
  }
  second->setClock({true, wire::ClockMode::kStepped, 0});
  second->step({20'000, false});
  while (first->clock().said().step != 1) ASSERT_TRUE(first->waitForClock(first->clock().version(), kTimeout));
  EXPECT_EQ(first->clock().said().time, 20'000u);
  EXPECT_THROW(join(helloOf("third"), "lab&clock=real-time"), std::runtime_error);
}

TEST_F(MembersTest, WhoLeavesIsNotWaitedForAndAnotherTakesTheClock) {
  auto owner = join(helloOf("owner")), lazy = join(helloOf("lazy")), next = join(helloOf("next"));
  owner->setClock({true, wire::ClockMode::kStepped, 0});
  while (owner->clock().said().owner == 0) ASSERT_TRUE(owner->waitForClock(owner->clock().version(), kTimeout));
  owner->step({1000, true});
  while (next->clock().said().step != 1) ASSERT_TRUE(next->waitForClock(next->clock().version(), kTimeout));
  next->stepDone({1});
  lazy.reset();
  while (!owner->clock().said().waitsFor.empty() || owner->clock().said().step != 1)
    ASSERT_TRUE(owner->waitForClock(owner->clock().version(), kTimeout));
  next->setClock({true, wire::ClockMode::kRealTime, 1});  // in vain
  std::this_thread::sleep_for(300ms);
  EXPECT_EQ(next->clock().said().owner, owner->world().camera);
  owner.reset();
  while (next->clock().said().owner != 0) ASSERT_TRUE(next->waitForClock(next->clock().version(), kTimeout));
  next->setClock({true, wire::ClockMode::kScaled, 3});
  while (next->clock().said().owner != next->world().camera) ASSERT_TRUE(next->waitForClock(next->clock().version(), kTimeout));
  EXPECT_EQ(next->clock().said().rate, 3);
}

TEST_F(MembersTest, TheStateOfAMemberComesWithItsPose) {
  auto car = join(helloOf("car")), watcher = join(helloOf("watcher"));
  const auto seen = [&](Connection& of) {
    const auto others = of.others();
    if (!others || others->others().size() != 1) return std::vector<std::uint8_t>{0xee};
    const auto& moved = others->others().begin()->second.member.moved;
    return moved ? moved->pose.state : std::vector<std::uint8_t>{0xdd};
  };
  wire::PoseMessage pose = poseAt(1);
  pose.state = {0, 1, 0xff};
  car->send(pose);
  EXPECT_TRUE(testing_support::await([&] { return seen(*watcher) == pose.state; }));
  auto late = join(helloOf("late"));
  watcher.reset();
  EXPECT_TRUE(testing_support::await([&] { return seen(*late) == pose.state; })) << "who joins later hears of it, too";
  pose = poseAt(2);
  car->send(pose);
  EXPECT_TRUE(testing_support::await([&] { return seen(*late).empty(); })) << "the newest pose has none";
  pose.sequence = 3;
  pose.state.resize(wire::kMaxStateBytes + 1);
  car->send(pose);
  ASSERT_TRUE(testing_support::await([&] { return car->error().has_value(); }));
  EXPECT_NE(car->error()->message.find("Pose.state must be at most 256 bytes"), std::string::npos) << car->error()->message;
}

TEST_F(MembersTest, AnOldClientIsSentNothingNew) {
  wire::Hello old;  // wants nothing
  auto client = join(old);
  auto other = join(helloOf("other"));
  other->send(poseAt(1));
  ASSERT_TRUE(other->receive(kTimeout));
  client->send(poseAt(1));
  ASSERT_TRUE(client->receive(kTimeout));
  EXPECT_FALSE(client->others());
  EXPECT_EQ(client->clock().version(), 0u);
  EXPECT_FALSE(client->error());
  EXPECT_TRUE(testing_support::await([&] { return other->others() && other->others()->others().size() == 1; }));
}

}  // namespace
}  // namespace ridgecast
