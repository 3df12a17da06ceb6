// Who is near is judged by a sort of all members; what a member is told, by a table that it keeps by the protocol's rules alone.
#include "server/presence/crowd.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "common/wire/wire.h"
#include "server/presence/members_messages.h"
#include "server/presence/news.h"
#include "server/presence/presence.h"
#include "tests/support/bytes.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::presence {
namespace {

using namespace std::chrono_literals;
using testing_support::SimulatedTimer;

wire::PoseMessage poseAt(lattice::Step x, lattice::Step z, double y = 1, std::uint64_t sequence = 1, std::size_t state = 0) {
  wire::PoseMessage pose{sequence, {}, std::vector<std::uint8_t>(state, 7)};
  pose.camera.pose = {.x = x, .z = z, .y = y};
  return pose;
}

// All but itself: with a place by distance, then without; equal ones by number.
std::vector<std::uint64_t> sorted(const std::map<std::uint64_t, wire::Member>& all, std::uint64_t self) {
  std::vector<std::tuple<bool, long double, std::uint64_t>> order;
  const auto& from = all.at(self).moved;
  for (const auto& [camera, member] : all) {
    if (camera == self) continue;
    long double square = 0;
    if (from && member.moved) {
      const auto &a = from->pose.camera.pose, &b = member.moved->pose.camera.pose;
      const long double x = a.x - b.x, z = a.z - b.z, y = (static_cast<long double>(a.y) - b.y) * 256;
      square = x * x + y * y + z * z;
    }
    order.emplace_back(from && !member.moved, square, camera);
  }
  std::ranges::sort(order);
  std::vector<std::uint64_t> out;
  for (const auto& [isUnplaced, square, camera] : order) out.push_back(camera);
  return out;
}

// Places where searches differ: all at one, around a cell's corner, a plain, islands far apart, the ends of the lattice.
lattice::Step coordinate(int world, std::mt19937_64& random) {
  const auto upTo = [&](std::int64_t n) { return static_cast<lattice::Step>(random() % static_cast<std::uint64_t>(n)); };
  switch (world) {
    case 0:
      return 12'345;
    case 1:
      return upTo(9) - 4;
    case 2:
      return upTo(20 * 65'536) - 10 * 65'536;
    case 3:
      return (upTo(3) - 1) * (lattice::kMaxPosition / 8 * 7) + upTo(1000);
    default:
      return upTo(2) == 0 ? lattice::kMaxPosition : -lattice::kMaxPosition;
  }
}

TEST(Crowd, TheNearestAreThoseOfASortOfAll) {
  std::mt19937_64 random(7);
  for (int world = 0; world < 5; ++world) {
    Crowd crowd;
    std::map<std::uint64_t, wire::Member> all;
    for (int round = 0; round < 3000; ++round) {
      const std::uint64_t camera = 1 + random() % 200;
      const auto known = all.find(camera);
      if (known == all.end()) {
        wire::Member member;
        member.camera = camera;
        if (random() % 4 != 0) member.moved = wire::Moved{camera, poseAt(coordinate(world, random), coordinate(world, random)), 0};
        all[camera] = member;
        crowd.add(member);
      } else if (random() % 5 == 0) {
        all.erase(known);
        crowd.remove(camera);
      } else {
        known->second.moved = wire::Moved{camera, poseAt(coordinate(world, random), coordinate(world, random), random() % 3), 0};
        crowd.move(*crowd.find(camera), *known->second.moved);
      }
      if (round % 10 != 0 || all.empty()) continue;
      const auto self = std::next(all.begin(), static_cast<std::ptrdiff_t>(random() % all.size()))->first;
      auto expected = sorted(all, self);
      const std::size_t count = random() % 40;
      expected.resize(std::min(expected.size(), count));
      std::vector<std::uint64_t> found;
      for (const Crowd::Participant* who : crowd.nearest(*crowd.find(self), count)) found.push_back(who->member().camera);
      ASSERT_EQ(found, expected) << "world " << world << ", round " << round << ", from " << self;
      const auto counts = crowd.counts(1 + random() % 40);
      std::map<std::pair<std::int64_t, std::int64_t>, std::uint32_t> cells;
      for (const auto& [c, member] : all)
        if (member.moved) {
          const auto& pose = member.moved->pose.camera.pose;
          const double side = std::ldexp(256 * 256, static_cast<int>(counts.level));
          ++cells[{static_cast<std::int64_t>(std::floor(static_cast<double>(pose.x) / side)),
                   static_cast<std::int64_t>(std::floor(static_cast<double>(pose.z) / side))}];
        }
      ASSERT_EQ(counts.i.size(), cells.size());
      for (std::size_t k = 0; k < counts.i.size(); ++k) {
        const std::pair<std::int64_t, std::int64_t> cell{counts.i[k], counts.j[k]};
        ASSERT_EQ(counts.count[k], cells[cell]);
      }
    }
  }
}

TEST(Crowd, CountsHaveTheLeastCellsThatAreFewEnough) {
  Crowd crowd;
  for (std::uint64_t k = 0; k < 64; ++k) {
    const auto at = static_cast<lattice::Step>(k << wire::kCellBits);
    crowd.add({k + 1, wire::Role::kViewer, "", wire::Moved{k + 1, poseAt(at, 0), 0}});
  }
  EXPECT_EQ(crowd.counts(64).level, 0u);
  EXPECT_EQ(crowd.counts(63).level, 1u);
  EXPECT_EQ(crowd.counts(16).count, std::vector<std::uint32_t>(16, 4));
  for (std::uint64_t k = 0; k < 4; ++k) {
    const lattice::Step x = k % 2 ? lattice::kMaxPosition : -lattice::kMaxPosition,
                        z = k / 2 ? lattice::kMaxPosition : -lattice::kMaxPosition;
    crowd.add({100 + k, wire::Role::kViewer, "", wire::Moved{100 + k, poseAt(x, z), 0}});
  }
  const auto four = crowd.counts(1);
  EXPECT_EQ(four.count.size(), 4u) << "a quadrant each";
  EXPECT_LE(four.level, wire::kMaxCrowdLevel);
}

// ---- what members are told ----

class Listener final : public conversation::Sender {
 public:
  explicit Listener(const scheduling::Timer& timer) : timer_(timer) {}
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    EXPECT_FALSE(std::holds_alternative<wire::Members>(message)) << "these are encoded once for many";
  }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    if (isSlow) tickets_.push_back(std::move(ticket));
    auto decoded = wire::decodeServer(testing_support::bytesOf(*encoded));
    ASSERT_TRUE(decoded) << decoded.error().message;
    const auto& m = std::get<wire::Members>(*decoded);
    bytes += encoded->size();
    ++messages;
    for (const auto& j : m.joined) {
      ASSERT_TRUE(table.emplace(j.camera, j).second) << j.camera << " joined twice";
      told[j.camera].push_back(timer_.now());
    }
    for (const auto& v : m.moved) {
      ASSERT_TRUE(table.contains(v.camera)) << v.camera << " moved without having joined";
      ASSERT_NE(table[v.camera].moved, v) << "nothing is told twice";
      table[v.camera].moved = v;
      told[v.camera].push_back(timer_.now());
    }
    for (const auto& gone : {m.left, m.faded})
      for (const auto camera : gone) {
        ASSERT_EQ(table.erase(camera), 1u) << camera << " left without having joined";
        told.erase(camera);
      }
    left.insert(m.left.begin(), m.left.end());
    if (m.crowd) crowd = *m.crowd;
    others = m.others;
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override { ADD_FAILURE(); }
  void readOn() {
    isSlow = false;
    tickets_.clear();
  }

  bool isSlow = false;
  std::map<std::uint64_t, wire::Member> table;
  std::map<std::uint64_t, std::vector<scheduling::Timer::Time>> told;
  std::set<std::uint64_t> left;
  wire::Crowd crowd;
  std::uint32_t others = 0;
  std::size_t bytes = 0, messages = 0;

 private:
  const scheduling::Timer& timer_;
  std::vector<std::shared_ptr<const void>> tickets_;
};

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
  constexpr std::uint64_t kMembers = 600;
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
  for (std::uint64_t k = 3; k <= 500; ++k) w.join(k, 24, false);
  w.clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
  w.timer.advance(1s);
  for (int round = 0; round < 20; ++round) {
    for (std::uint64_t k = 3; k <= 500; ++k) w.move(k, round, static_cast<lattice::Step>(k), 256);
    w.timer.advance(50ms);
    for (std::uint64_t k = 3; k <= 500; ++k) ASSERT_EQ(owner->table[k].moved, w.all[k].moved);
  }
  EXPECT_LE(modest->table.size(), 120u);
}

// ---- other servers ----

struct Server {
  explicit Server(const SimulatedTimer& timer, std::shared_ptr<bus::Bus> to)
      : presence(std::make_shared<Presence>(timer, std::make_shared<clock::SessionClock>(timer))), bus(std::move(to)) {
    presence->share(bus, "members/default");
  }
  std::set<std::uint64_t> members() const {
    std::set<std::uint64_t> out;
    for (const auto& member : presence->state().members) out.insert(member.camera);
    return out;
  }
  std::shared_ptr<Presence> presence;
  std::shared_ptr<bus::Bus> bus;
};

wire::Hello helloOf(std::string name, bool members = false) {
  wire::Hello hello;
  hello.clientName = std::move(name);
  hello.members = members;
  hello.clock = true;
  return hello;
}

TEST(SharedMembers, AreThoseOfAllServersUntilTheyLeaveOrFallSilent) {
  SimulatedTimer timer;
  testing_support::SimulatedEngine engine(timer);
  Server a(timer, engine.connect());
  auto b = std::make_unique<Server>(timer, engine.connect());
  const auto watcher = std::make_shared<Listener>(timer);
  a.presence->join(1, helloOf("a", true), watcher, {});
  b->presence->join(2, helloOf("b"), nullptr, poseAt(5, 6, 1, 1, 256));
  b->presence->join(3, helloOf("c"), nullptr, {});
  timer.advance(150ms);
  EXPECT_EQ(a.members(), (std::set<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(b->members(), (std::set<std::uint64_t>{1, 2, 3}));
  EXPECT_EQ(a.presence->state().members, b->presence->state().members) << "name, role, place, state, clock";
  EXPECT_EQ(watcher->table[2].name, "b");
  b->presence->receive(2, poseAt(50, 60, 1, 2));
  timer.advance(150ms);
  EXPECT_EQ(watcher->table[2].moved->pose.camera.pose.x, 50);
  b->presence->leave(3);
  timer.advance(150ms);
  EXPECT_EQ(watcher->left, std::set<std::uint64_t>{3});

  engine.cut(*b->bus);
  timer.advance(2500ms);
  EXPECT_TRUE(watcher->table.contains(2)) << "what was lost may come again";
  timer.advance(1s);
  EXPECT_FALSE(watcher->table.contains(2));
  EXPECT_EQ(a.members(), std::set<std::uint64_t>{1});
  b->presence->receive(2, poseAt(70, 60, 1, 3));
  engine.mend(*b->bus);
  timer.advance(1500ms);
  ASSERT_TRUE(watcher->table.contains(2)) << "it is heard of again";
  EXPECT_EQ(watcher->table[2].moved->pose.camera.pose.x, 70);
  EXPECT_EQ(b->members(), (std::set<std::uint64_t>{1, 2}));

  b->presence = nullptr;
  timer.advance(50ms);
  EXPECT_FALSE(watcher->table.contains(2)) << "a session that ends says so";
}

TEST(SharedMembers, ASilentEngineAndWrongMessagesDoNoHarm) {
  SimulatedTimer timer;
  testing_support::SimulatedEngine engine(timer);
  Server a(timer, engine.connect());
  const auto other = engine.connect();
  a.presence->join(1, helloOf("a"), nullptr, {});
  wire::Members named;
  named.joined = {{1, wire::Role::kSensor, "somebody else", {}}, {2, wire::Role::kViewer, "b", {}}};
  named.left = {1};
  const std::string good = std::string(1, MembersMessages::kFormat) + wire::encodeMembers(wire::encodePart(named));
  std::vector<std::string> wrong{"",
                                 "x",
                                 "\x02" + good.substr(1),
                                 good.substr(0, good.size() - 1),
                                 std::string(1, MembersMessages::kFormat) + wire::encode(wire::ServerMessage(wire::Clock{})),
                                 std::string(MembersMessages::kMaxBytes + 1, MembersMessages::kFormat)};
  named.joined = {{0, wire::Role::kViewer, "nobody", {}}};
  wrong.push_back(std::string(1, MembersMessages::kFormat) + wire::encodeMembers(wire::encodePart(named)));
  for (const std::string& message : wrong) other->tell("members/default", message);
  timer.advance(50ms);
  EXPECT_EQ(a.presence->malformed(), wrong.size());
  EXPECT_EQ(a.members(), std::set<std::uint64_t>{1});
  other->tell("members/default", good);
  timer.advance(50ms);
  EXPECT_EQ(a.members(), (std::set<std::uint64_t>{1, 2}));
  EXPECT_EQ(a.presence->state().members[0].name, "a") << "a server's own members are its own";
  // A number that was another server's member: whoever joins here has it.
  a.presence->join(2, helloOf("mine"), nullptr, {});
  EXPECT_EQ(a.presence->state().members[1].name, "mine");
}

TEST(SharedMembers, MessagesAreAsLargeAsTheyMayBe) {
  MembersMessages messages;
  std::size_t count = 0;
  for (std::uint64_t camera = 1; camera <= 2000; ++camera)
    messages.add({camera, wire::Role::kViewer, std::string(100, 'n'), wire::Moved{camera, poseAt(1, 2, 3, 4, 256), 5}});
  messages.left(7777);
  const auto all = messages.take();
  EXPECT_GT(all.size(), 2u);
  for (std::size_t k = 0; k < all.size(); ++k) {
    EXPECT_LE(all[k].size(), MembersMessages::kMaxBytes);
    if (k + 1 < all.size()) {
      EXPECT_GT(all[k].size(), MembersMessages::kMaxBytes - 1000);
    }
    const auto read = membersOf(all[k]);
    ASSERT_TRUE(read) << read.error().message;
    for (const auto& member : read->joined) EXPECT_EQ(member.camera, ++count);
    if (k + 1 == all.size()) {
      EXPECT_EQ(read->left, std::vector<std::uint64_t>{7777});
    }
  }
  EXPECT_EQ(count, 2000u);
}

// Two servers with random members and a bus that loses and delays: 3 s after the last fault both know the same, and everybody's table is
// that of its own.
TEST(SharedMembers, AgreeAfterAnyFault) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::mt19937_64 random(seed);
    SimulatedTimer timer;
    testing_support::SimulatedEngine engine(timer, seed);
    std::vector<std::unique_ptr<Server>> servers;
    for (int k = 0; k < 3; ++k) servers.push_back(std::make_unique<Server>(timer, engine.connect()));
    std::map<std::uint64_t, std::size_t> home;
    std::map<std::uint64_t, std::shared_ptr<Listener>> listeners;
    std::uint64_t last = 0;
    for (int round = 0; round < 400; ++round) {
      const auto any = [&] { return std::next(home.begin(), static_cast<std::ptrdiff_t>(random() % home.size())); };
      const auto what = random() % 20;
      const std::size_t at = random() % servers.size();
      if (home.empty() || what < 4) {
        listeners[++last] = std::make_shared<Listener>(timer);
        wire::Hello hello = helloOf("m", true);
        hello.near = random() % 2 * 24;
        hello.states = true;
        servers[at]->presence->join(last, hello, listeners[last], {});
        home[last] = at;
      } else if (what == 5) {
        const auto gone = any();
        servers[gone->second]->presence->leave(gone->first);
        listeners.erase(gone->first);
        home.erase(gone);
      } else if (what == 6) {
        engine.cut(*servers[at]->bus);
      } else if (what == 7) {
        engine.mend(*servers[at]->bus);
      } else if (what == 8) {
        engine.slow(std::chrono::milliseconds(random() % 300));
      } else {
        const auto mover = any();
        servers[mover->second]->presence->receive(mover->first,
                                                  poseAt(coordinate(1, random), coordinate(1, random), 1, 1 + random() % 1000));
      }
      timer.advance(std::chrono::milliseconds(random() % 60));
    }
    for (const auto& server : servers) engine.mend(*server->bus);
    engine.slow(0ms);
    timer.advance(8s);
    std::set<std::uint64_t> all;
    for (const auto& [camera, server] : home) all.insert(camera);
    for (const auto& server : servers) {
      ASSERT_EQ(server->members(), all) << "seed " << seed;
      ASSERT_EQ(server->presence->malformed(), 0u);
    }
    for (std::size_t k = 1; k < servers.size(); ++k) {
      const auto ours = servers[0]->presence->state().members, theirs = servers[k]->presence->state().members;
      for (std::size_t m = 0; m < ours.size(); ++m) ASSERT_EQ(ours[m], theirs[m]) << "seed " << seed;
    }
    for (const auto& [camera, listener] : listeners) {
      if (all.size() > 65) continue;
      std::set<std::uint64_t> known;
      for (const auto& [other, member] : listener->table) known.insert(other);
      known.insert(camera);
      ASSERT_EQ(known, all) << "seed " << seed << ", member " << camera;
    }
  }
}

}  // namespace
}  // namespace ridgecast::presence
