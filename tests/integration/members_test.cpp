// Eight members of one session, two of them sensors, over loopback: each sees the others, and their clocks agree. RIDGECAST_MEMBERS_SECONDS
// makes it longer than a few seconds; MEASURE=1, on a machine that does nothing else, says how soon and how closely.

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <memory>
#include <mutex>
#include <stdexcept>
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
    open();
    listen();
  }
  std::unique_ptr<Connection> join(const wire::Hello& hello) {
    const std::string url = "127.0.0.1:" + std::to_string(server->port());
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

// A row of members, 100 m apart: the first is told of those near it and of how many there are, one of an earlier revision of each.
TEST_F(MembersTest, ACrowdIsNamedWhereItIsNearAndCountedElsewhere) {
  constexpr std::size_t kMembers = 100;
  std::vector<std::unique_ptr<Connection>> members;
  for (std::size_t k = 0; k < kMembers; ++k) {
    wire::Hello hello = helloOf("member " + std::to_string(k));
    hello.placesOnly = true;
    hello.near = k == 1 ? 0 : 24;
    members.push_back(join(hello));
    wire::PoseMessage pose = poseAt(1);
    pose.camera.pose.x = static_cast<lattice::Step>(k) * 100 * 256;
    pose.state = {static_cast<std::uint8_t>(k)};
    members.back()->send(pose);
  }
  const auto counted = [](const core::Roster& roster) {
    std::size_t sum = 0;
    for (const std::uint32_t count : roster.crowd().count) sum += count;
    return sum;
  };
  ASSERT_TRUE(testing_support::await([&] {
    const auto roster = members[0]->others();
    return roster && roster->count() == kMembers - 1 && counted(*roster) == kMembers && roster->others().size() >= 64;
  }));
  const auto first = *members[0]->others();
  EXPECT_LE(first.others().size(), 96u);
  for (std::size_t k = 1; k <= 64; ++k) EXPECT_TRUE(first.others().contains(members[k]->world().camera)) << k;
  EXPECT_FALSE(first.others().contains(members.back()->world().camera));
  for (const auto& [camera, other] : first.others())
    if (other.member.moved) EXPECT_TRUE(other.member.moved->pose.state.empty()) << "it did not ask for states";
  ASSERT_TRUE(testing_support::await([&] {
    const auto roster = members[1]->others();
    return roster && roster->others().size() == kMembers - 1 && std::ranges::all_of(roster->others(), [](const auto& known) {
             return known.second.member.moved && known.second.member.moved->pose.state.size() == 1;
           });
  })) << "who knows no crowds knows each";
  EXPECT_TRUE(members[1]->others()->crowd().count.empty());
  // The farthest comes near, and goes: it has not left.
  const std::uint64_t last = members.back()->world().camera;
  members.back()->send(poseAt(2));
  ASSERT_TRUE(testing_support::await([&] { return members[0]->others()->others().contains(last); }));
  wire::PoseMessage away = poseAt(3);
  away.camera.pose.x = lattice::kMaxPosition;
  members.back()->send(away);
  ASSERT_TRUE(testing_support::await([&] { return !members[0]->others()->others().contains(last); }));
  EXPECT_EQ(members[0]->others()->count(), kMembers - 1);
  members.pop_back();
  EXPECT_TRUE(testing_support::await([&] { return members[0]->others()->count() == kMembers - 2; }));
  for (const auto& member : members) EXPECT_FALSE(member->error()) << member->error()->message;
}

}  // namespace
}  // namespace ridgecast
