// The members of several servers' session, over a bus that loses and delays.
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "common/wire/wire.h"
#include "server/presence/members_messages.h"
#include "server/presence/presence.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"
#include "tests/unit/server/presence/listener.h"

namespace ridgecast::presence {
namespace {

using namespace std::chrono_literals;
using testing_support::SimulatedTimer;

struct Server {
  explicit Server(const SimulatedTimer& timer, std::shared_ptr<bus::Bus> to)
      : clock(std::make_shared<clock::SessionClock>(timer)), presence(std::make_shared<Presence>(timer, clock)), bus(std::move(to)) {
    presence->share(bus, "members/default");
    clock->share(bus, "clock/default", [weak = std::weak_ptr(presence)] {
      if (const auto its = weak.lock()) its->tellForStep();
    });
  }
  std::set<std::uint64_t> members() const {
    std::set<std::uint64_t> out;
    for (const auto& member : presence->state().members) out.insert(member.camera);
    return out;
  }
  std::shared_ptr<clock::SessionClock> clock;
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
// Takes part in steps by what it is told alone, as a client does: it moves, and is done.
class Follower final : public conversation::Sender {
 public:
  static constexpr std::uint64_t kSteps = 60;
  Follower(const SimulatedTimer& timer, Presence& presence, std::uint64_t camera, std::size_t all, std::mt19937_64& random)
      : timer_(timer), presence_(presence), camera_(camera), all_(all), random_(random), table_(timer) {}

  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    table_.sendShared(std::move(encoded), std::move(ticket));
  }
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const auto* clock = std::get_if<wire::Clock>(&message);
    if (!clock || clock->mode != wire::ClockMode::kStepped || clock->step == 0) return;
    if (const std::uint64_t whole = clock->step - (clock->waitsFor.empty() ? 0 : 1); whole > read_) readAll(read_ = whole);
    if (std::ranges::find(clock->waitsFor, camera_) != clock->waitsFor.end() && clock->step > moved_) {
      moved_ = clock->step;
      later([this, step = moved_] {
        presence_.receive(camera_, poseAt(1, 1, 1, step));
        later([this, step] { presence_.done(camera_, {step}); });
      });
    }
    if (clock->owner == camera_ && clock->waitsFor.empty() && clock->step < kSteps && clock->step >= stepped_) {
      stepped_ = clock->step + 1;
      later([this] { step(); });
    }
  }
  void step() {  // by the owner, whom no step waits for
    presence_.receive(camera_, poseAt(1, 1, 1, stepped_));
    presence_.step(camera_, {20'000, true});
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override { ADD_FAILURE(); }
  std::uint64_t read() const { return read_; }

 private:
  void later(std::function<void()> what) { timer_.at(timer_.now() + std::chrono::microseconds(random_() % 5000), std::move(what)); }
  void readAll(std::uint64_t step) const {
    EXPECT_EQ(table_.table.size(), all_ - 1);
    for (const auto& [camera, member] : table_.table) {
      ASSERT_TRUE(member.moved) << camera;
      // One that has heard of the next step before may already be there.
      EXPECT_GE(member.moved->pose.sequence, step) << "member " << camera << " as member " << camera_ << " sees it after step " << step;
      EXPECT_LE(member.moved->pose.sequence, step + 1);
    }
  }

  const SimulatedTimer& timer_;
  Presence& presence_;  // which holds this
  const std::uint64_t camera_;
  const std::size_t all_;
  std::mt19937_64& random_;
  Listener table_;
  std::uint64_t read_ = 0, moved_ = 0, stepped_ = 1;
};

TEST(SharedMembers, AreReadAfterAStepAsOfThatStep) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    SimulatedTimer timer;
    testing_support::SimulatedEngine engine(timer, seed);
    engine.slow(std::chrono::microseconds(random() % 2000), std::chrono::milliseconds(random() % 20));
    std::vector<std::unique_ptr<Server>> servers;
    for (int k = 0; k < 3; ++k) servers.push_back(std::make_unique<Server>(timer, engine.connect()));
    timer.advance(1s);
    const std::size_t count = 2 + random() % 8;
    std::vector<std::shared_ptr<Follower>> members;
    for (std::uint64_t camera = 1; camera <= count; ++camera) {
      auto& presence = servers[random() % servers.size()]->presence;
      members.push_back(std::make_shared<Follower>(timer, *presence, camera, count, random));
      presence->join(camera, helloOf("m", true), members.back(), {});
    }
    timer.advance(2s);
    for (const auto& server : servers) server->clock->receive(1, wire::SetClock{true, wire::ClockMode::kStepped, 0});
    timer.advance(1s);
    members.front()->step();
    timer.advance(60s);
    for (const auto& member : members) ASSERT_EQ(member->read(), Follower::kSteps);
  }
}

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
