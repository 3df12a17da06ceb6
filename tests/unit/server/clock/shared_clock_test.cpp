// A session's clock on several servers, over a simulated engine: hours in milliseconds, the same course for the same seed.
#include "server/clock/shared_clock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <random>
#include <set>

#include "server/clock/messages.h"
#include "server/clock/session_clock.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::clock {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;
using wire::ClockMode;

// Passes everything on, and notes whose writes the engine took.
class SpiedBus final : public bus::Bus {
 public:
  using Holders = std::map<std::uint64_t, std::uint32_t>;  // by epoch
  SpiedBus(std::shared_ptr<Bus> to, std::shared_ptr<Holders> holders) : to_(std::move(to)), holders_(std::move(holders)) {}
  std::uint32_t server() const override { return to_->server(); }
  bool isAway() const override { return to_->isAway(); }
  std::int64_t now() const override { return to_->now(); }
  void append(const std::string& log, std::uint64_t after, std::vector<std::string> entries, Origin origin,
              std::function<void(bus::Appended)> done) override {
    to_->append(log, after, std::move(entries), origin, std::move(done));
  }
  void read(const std::string& log, std::uint64_t after, std::size_t most,
            std::function<void(Outcome<std::vector<bus::Entry>>)> done) override {
    to_->read(log, after, most, std::move(done));
  }
  bus::Subscription watch(const std::string& log, std::function<void(std::uint64_t)> changed) override {
    return to_->watch(log, std::move(changed));
  }
  void tell(const std::string& channel, std::string message) override { to_->tell(channel, std::move(message)); }
  bus::Subscription hear(const std::string& channel, std::function<void(const std::string&)> heard) override {
    return to_->hear(channel, std::move(heard));
  }
  void hold(const std::string& key, std::string value, std::uint64_t epoch, std::chrono::milliseconds life,
            std::function<void(Outcome<Held>)> done) override {
    to_->hold(key, std::move(value), epoch, life, noting(std::move(done)));
  }
  void take(const std::string& key, std::uint64_t epoch, std::function<void(Outcome<Held>)> done) override {
    to_->take(key, epoch, noting(std::move(done)));
  }
  void drop(const std::string& key, std::uint64_t epoch) override { to_->drop(key, epoch); }
  void list(const std::string& prefix, std::function<void(Outcome<std::map<std::string, bus::Record>>)> done) override {
    to_->list(prefix, std::move(done));
  }
  const Bus& inner() const { return *to_; }

 private:
  std::function<void(Outcome<Held>)> noting(std::function<void(Outcome<Held>)> done) {
    return [holders = holders_, server = server(), done = std::move(done)](Outcome<Held> held) {
      if (held && held->isYours) {
        const auto first = holders->emplace(held->record.epoch, server).first->second;
        EXPECT_EQ(first, server) << "two servers wrote in epoch " << held->record.epoch;
      }
      done(std::move(held));
    };
  }
  const std::shared_ptr<Bus> to_;
  const std::shared_ptr<Holders> holders_;
};

// Judges what it hears: time does not go back.
class Hearer final : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void>) override {
    const auto* clock = std::get_if<wire::Clock>(&message);
    if (!clock) return;
    if (!clocks.empty()) {
      EXPECT_GE(clock->time, clocks.back().time) << "time went back";
      EXPECT_TRUE(!judgesSteps || clock->step >= clocks.back().step) << "a step was taken back";
    }
    clocks.push_back(*clock);
    if (!clock->notice.empty()) notice = clock->notice;
  }
  void sendShared(std::shared_ptr<const std::string>, std::shared_ptr<const void>) override {}
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override {}
  const wire::Clock& last() const { return clocks.back(); }
  bool isAwaited(std::uint64_t id) const { return std::ranges::find(last().waitsFor, id) != last().waitsFor.end(); }

  bool judgesSteps = true;
  std::vector<wire::Clock> clocks;
  std::string notice;  // the last
};

struct Server {
  std::shared_ptr<SpiedBus> bus;
  std::shared_ptr<SessionClock> clock;
  std::map<std::uint64_t, std::shared_ptr<Hearer>> members;
  std::uint64_t shown = 0;  // microseconds
};

class Servers {
 public:
  explicit Servers(std::uint64_t seed = 1, ClockMode mode = ClockMode::kRealTime) : engine(timer, seed), mode_(mode) {}

  Server& start() {
    Server& server = servers.emplace_back();
    server.bus = std::make_shared<SpiedBus>(engine.connect(), holders_);
    server.clock = std::make_shared<SessionClock>(timer, mode_);
    server.clock->share(server.bus, "clock/s");
    return server;
  }
  void crash(std::size_t k) {
    engine.cut(servers[k].bus->inner());
    servers.erase(servers.begin() + static_cast<std::ptrdiff_t>(k));
  }
  std::shared_ptr<Hearer> join(Server& server, std::uint64_t id, bool follows = true) {
    auto hearer = std::make_shared<Hearer>();
    hearer->judgesSteps = judgesSteps;
    wire::Hello hello;
    hello.clock = follows;
    server.clock->join(id, hello, hearer, {});
    return server.members[id] = hearer;
  }
  // Of all servers: what a member would see. Time is looked at, so that it would be seen to go back.
  std::vector<wire::Clock> shown() {
    std::vector<wire::Clock> out;
    for (Server& server : servers) {
      out.push_back(server.clock->state());
      EXPECT_GE(out.back().time, server.shown) << "time went back";
      server.shown = out.back().time;
    }
    return out;
  }
  bool areEqual() {
    const auto all = shown();
    const auto ofOne = [](const wire::Clock& c) { return std::tuple(c.mode, c.rate, c.time, c.owner, c.step, c.waitsFor); };
    return std::ranges::all_of(all, [&](const wire::Clock& c) { return ofOne(c) == ofOne(all.front()); });
  }
  void advance(SimulatedTimer::Time::duration by) {
    timer.advance(by);
    shown();
  }

  SimulatedTimer timer;
  SimulatedEngine engine;
  std::deque<Server> servers;
  bool judgesSteps = true;

 private:
  const ClockMode mode_;
  const std::shared_ptr<SpiedBus::Holders> holders_ = std::make_shared<SpiedBus::Holders>();
};

constexpr wire::SetClock kStepped{true, ClockMode::kStepped, 0};

TEST(SharedClock, OfTwoServersIsOneClock) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.advance(1s);
  const auto one = s.join(a, 1), two = s.join(b, 2);
  s.advance(1s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(a.clock->time(), 2'000'000u);
  b.clock->receive(2, kStepped);
  s.advance(0s);
  EXPECT_EQ(one->last().owner, 2u);
  a.clock->receive(1, kStepped);
  s.advance(0s);
  EXPECT_THAT(one->notice, HasSubstr("belongs to member 2"));
  EXPECT_EQ(b.clock->step(2, {20'000, true}), Clock::Stepped::kQueues);
  EXPECT_EQ(b.clock->step(2, {20'000, true}), Clock::Stepped::kQueues);
  s.advance(0s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(one->last().step, 1u);
  EXPECT_EQ(one->last().waitsFor, std::vector<std::uint64_t>{1});
  a.clock->receive(1, wire::StepDone{1});
  s.advance(0s);
  EXPECT_EQ(two->last().step, 2u);
  EXPECT_EQ(two->last().time, 2'040'000u);
  a.clock->leave(1);
  s.advance(1s);
  EXPECT_TRUE(b.clock->state().waitsFor.empty());
  EXPECT_TRUE(s.areEqual());
}

TEST(SharedClock, AnswersOnOtherServersThanTheLeaders) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.join(a, 1);
  const auto follows = s.join(b, 2), asks = s.join(b, 3, false);
  s.advance(1s);
  b.clock->step(2, {10, false});
  s.advance(0s);
  EXPECT_THAT(follows->notice, HasSubstr("Nobody owns the clock"));
  b.clock->receive(3, wire::SetClock{true, ClockMode::kScaled, 4});
  s.advance(0s);
  ASSERT_EQ(asks->clocks.size(), 1u) << "it follows nothing, and is answered";
  EXPECT_EQ(asks->last().rate, 4);
  b.clock->step(3, {10, false});
  s.advance(0s);
  EXPECT_THAT(asks->notice, HasSubstr("runs by itself"));
  b.clock->receive(3, wire::AskClock{7});
  EXPECT_EQ(asks->last().echo, 7u);
  b.clock->receive(3, wire::PassOver{9});
  s.advance(0s);
  EXPECT_THAT(asks->notice, HasSubstr("No step waits for member 9"));
  b.clock->receive(3, kStepped);
  b.clock->step(3, {10, true});
  b.clock->receive(3, wire::PassOver{1});
  s.advance(1s);
  EXPECT_EQ(b.clock->state().waitsFor, std::vector<std::uint64_t>{2});
  s.advance(30s);
  EXPECT_TRUE(b.clock->state().waitsFor.empty()) << "it was late";
  EXPECT_THAT(follows->notice, HasSubstr("not done within 30 s"));
  b.clock->leave(3);
  s.advance(1s);
  EXPECT_EQ(a.clock->state().owner, 0u);
}

TEST(SharedClock, GoesOnWhereItsLeaderLeftIt) {
  Servers s;
  s.start(), s.start(), s.start();
  s.join(s.servers[0], 1), s.join(s.servers[1], 2), s.join(s.servers[2], 3);
  s.advance(1s);
  s.servers[1].clock->receive(2, kStepped);
  s.servers[1].clock->step(2, {50, true});
  s.servers[1].clock->step(2, {50, true});
  s.advance(100ms);
  s.servers[2].clock->receive(3, wire::StepDone{1});
  s.advance(SharedClock::kTick);
  const std::uint64_t before = s.servers[1].clock->time();
  EXPECT_EQ(s.servers[1].clock->state().waitsFor.size(), 1u);
  s.crash(0);
  s.servers[0].clock->step(2, {50, true});  // nobody leads
  s.advance(3'500ms);
  EXPECT_EQ(s.servers[0].clock->state().step, 1u) << "another leads, and waits for the member of the one that is gone";
  s.advance(3'500ms);
  EXPECT_EQ(s.servers[0].clock->state().step, 2u) << "that has left";
  s.servers[1].clock->receive(3, wire::StepDone{2});
  s.advance(100ms);
  EXPECT_EQ(s.servers[0].clock->state().step, 3u);
  EXPECT_EQ(s.servers[0].clock->time(), before + 100) << "each step once";
  EXPECT_TRUE(s.areEqual());
  s.start();
  s.advance(1s);
  EXPECT_TRUE(s.areEqual());
}

TEST(SharedClock, AnOrderlyEndIsNotWaitedFor) {
  Servers s;
  s.start(), s.start();
  s.join(s.servers[1], 2);
  s.advance(1s);
  const auto bus = s.servers[0].bus;
  s.servers.pop_front();
  s.advance(2 * SharedClock::kTick);
  s.servers[0].clock->receive(2, kStepped);
  s.advance(0s);
  EXPECT_EQ(s.servers[0].clock->state().owner, 2u);
}

TEST(SharedClock, StandsAndRefusesWithoutItsEngine) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  const auto one = s.join(a, 1), two = s.join(b, 2);
  s.advance(1s);
  b.clock->receive(2, wire::SetClock{true, ClockMode::kScaled, 10});
  s.advance(1s);
  EXPECT_EQ(a.clock->time(), 11'000'000u);
  s.engine.stop();
  s.advance(10s);
  EXPECT_EQ(a.clock->time(), 111'000'000u) << "it goes on as it is";
  for (auto* server : {&a, &b})
    for (const auto& [id, member] : server->members) {
      server->clock->receive(id, kStepped);
      EXPECT_THAT(member->notice, HasSubstr("cannot be reached"));
      member->notice.clear();
      server->clock->step(id, {10, true});
      EXPECT_THAT(member->notice, HasSubstr("cannot be reached"));
    }
  s.join(a, 4);
  s.engine.start();
  s.advance(2s);
  EXPECT_TRUE(s.areEqual());
  EXPECT_EQ(b.clock->state().mode, ClockMode::kScaled);
  b.clock->receive(2, kStepped);
  b.clock->step(2, {10, true});
  s.advance(100ms);
  EXPECT_EQ(b.clock->state().waitsFor, (std::vector<std::uint64_t>{1, 4})) << "who came meanwhile is a member";
}

TEST(SharedClock, OutlivesAllItsServers) {
  Servers s(1, ClockMode::kStepped);
  s.join(s.start(), 1);
  s.start();
  s.advance(1s);
  s.servers[0].clock->receive(1, kStepped);
  for (int k = 0; k < 5; ++k) s.servers[0].clock->step(1, {1000, false});
  s.advance(1s);
  s.crash(1), s.crash(0);
  s.advance(1h);
  s.start();
  s.advance(10s);
  EXPECT_EQ(s.servers[0].clock->time(), 5000u);
  EXPECT_EQ(s.servers[0].clock->state().step, 5u);
  EXPECT_EQ(s.servers[0].clock->state().owner, 0u) << "its members left";
  s.servers[0].clock->leave();
  s.advance(0s);
  s.servers.clear();
  s.start();
  s.advance(10s);
  EXPECT_EQ(s.servers[0].clock->state().step, 5u) << "the server left, and the session was not over";
  s.servers[0].clock->end();
  s.advance(0s);
  s.servers.clear();
  s.start();
  s.advance(1s);
  EXPECT_EQ(s.servers[0].clock->state().step, 0u) << "the session was over";
}

// A server shows a fast clock some milliseconds further than where it is stopped.
TEST(SharedClock, IsMovedToWhatSomebodyWasShown) {
  Servers s;
  Server &a = s.start(), &b = s.start();
  s.join(a, 1), s.join(b, 2);
  s.advance(1s);
  a.clock->receive(1, wire::SetClock{true, ClockMode::kScaled, 1000});
  s.advance(1s);
  s.engine.slow(50ms);
  a.clock->receive(1, kStepped);
  for (int k = 0; k < 20; ++k) s.advance(10ms);
  const std::uint64_t ahead = b.clock->time();
  EXPECT_GT(ahead, a.clock->time());
  s.advance(2s);
  EXPECT_EQ(a.clock->time(), ahead);
  EXPECT_TRUE(s.areEqual());
}

TEST(SharedClock, OnOneServerSendsNothingWhileNothingChanges) {
  Servers s;
  s.join(s.start(), 1);
  s.advance(10s);
  const auto before = s.engine.traffic();
  s.advance(30min);
  EXPECT_EQ(s.engine.traffic().tells, before.tells);
  EXPECT_EQ(s.engine.traffic().holds, before.holds);
  s.advance(3h);
  EXPECT_LE(s.engine.traffic().holds, before.holds + 4) << "the record is renewed";
}

TEST(SharedClock, MessagesAreReadAsTheyWereWritten) {
  Clock clock(Clock::Instant(7us), ClockMode::kStepped);
  for (std::uint64_t m : {3, 1, 1'000'000'007}) clock.follow(m);
  clock.set(1, kStepped, Clock::Instant(8us));
  for (int k = 0; k < 3; ++k) clock.step(1, {77, k != 1});
  clock.passOver(3);
  const Record record{9, 8, clock, {{5, {44, true, {1, 3}}}, {6, {45, false, {}}}}};
  const std::string told = toBytes(Told{3, true, record, {{1, "A sentence."}}});
  const auto read = toldOf(told);
  ASSERT_TRUE(read);
  EXPECT_EQ(toBytes(*read), told);
  EXPECT_EQ(read->record.clock.state(Clock::Instant(9us)).waitsFor, (std::vector<std::uint64_t>{1'000'000'007}));
  EXPECT_EQ(read->record.servers.at(5).members, (std::set<std::uint64_t>{1, 3}));
  ToldCalls calls{7, false, {{1, std::vector<ToldCalls::Member>{{4, true}, {5, false}}}}};
  for (const Call& call : {Call{Call::Kind::kSet, 4, {true, ClockMode::kScaled, 2.5, 9}}, Call{Call::Kind::kStep, 4, {}, {8, true}},
                           Call{Call::Kind::kDone, 4, {}, {}, 6}})
    calls.calls.push_back({2, {}, call});
  const std::string bytes = toBytes(calls);
  const auto back = toldCallsOf(bytes);
  ASSERT_TRUE(back);
  EXPECT_EQ(toBytes(*back), bytes);
  EXPECT_EQ(back->calls[1].call.set.rate, 2.5);
  for (std::size_t n = 0; n < told.size(); ++n) EXPECT_FALSE(toldOf(told.substr(0, n))) << n;
  for (std::size_t n = 0; n < bytes.size(); ++n) EXPECT_FALSE(toldCallsOf(bytes.substr(0, n))) << n;
  std::mt19937 random(3);
  for (int k = 0; k < 20'000; ++k) {  // hostile
    std::string other = k % 2 ? told : bytes;
    for (int n = 0; n < 3; ++n) other[random() % other.size()] = static_cast<char>(random());
    if (auto changed = toldOf(other)) changed->record.clock.leave(1'000'000'007, Clock::Instant(9us));
    (void)toldCallsOf(other);
  }
}

// ---- laws, whatever happens ----

// Members that come, go, set, step and are done, on servers that come, go and lose their engine.
class Course {
 public:
  enum class Kind { kSteps, kRuns, kLosesRecords };
  Course(std::uint64_t seed, Kind kind)
      : random_(seed), kind_(kind), servers_(seed, kind == Kind::kSteps ? ClockMode::kStepped : ClockMode::kRealTime) {
    for (int k = 0; k < 3; ++k) servers_.start();
    // Nobody knows what the engine lost while all who knew it were cut off.
    servers_.judgesSteps = kind != Kind::kLosesRecords;
    servers_.engine.notice(std::chrono::milliseconds(below(1500)));
  }

  void run() {
    for (int k = 0; k < 200 && !testing::Test::HasFailure(); ++k) {
      happen();
      advance(std::chrono::milliseconds(below(3) == 0 ? below(2000) : below(60)));
    }
    servers_.engine.slow(1ms);
    servers_.engine.start();
    servers_.engine.setClock(0us);
    for (Server& server : servers_.servers) servers_.engine.mend(server.bus->inner());
    for (int k = 0; k < 200; ++k) advance(200ms);
    EXPECT_TRUE(servers_.areEqual());
    // And it is a clock that can be used.
    Server& last = servers_.servers.back();
    for (const auto& [id, member] : last.members) last.clock->leave(id);
    last.members.clear();
    for (Server& server : servers_.servers)
      if (const std::uint64_t owner = server.clock->state().owner; server.members.contains(owner))
        server.clock->receive(owner, wire::SetClock{false, ClockMode::kRealTime, 1});
    advance(1s);
    const auto hearer = servers_.join(last, 1'000'000);
    last.clock->receive(1'000'000, wire::SetClock{true, ClockMode::kStepped, 0});
    advance(1s);
    EXPECT_EQ(hearer->last().owner, 1'000'000u) << hearer->notice;
    EXPECT_EQ(hearer->last().mode, ClockMode::kStepped);
    EXPECT_TRUE(servers_.areEqual());
  }

 private:
  std::uint64_t below(std::uint64_t n) { return random_() % n; }
  Server& any() { return servers_.servers[below(servers_.servers.size())]; }
  std::pair<const std::uint64_t, std::shared_ptr<Hearer>>* anyMember(Server& server) {
    if (server.members.empty()) return nullptr;
    return &*std::next(server.members.begin(), static_cast<std::ptrdiff_t>(below(server.members.size())));
  }

  void happen() {
    Server& server = any();
    const auto member = anyMember(server);
    switch (below(20)) {
      case 0:
      case 1:
        if (members_ < 12) ++members_, servers_.join(server, ++lastMember_, below(5) != 0);
        return;
      case 2:
        if (!member) return;
        gone(member->first);
        server.clock->leave(member->first);
        server.members.erase(member->first);
        return;
      case 3:
        cut_.insert(server.bus->server());
        return servers_.engine.cut(server.bus->inner());
      case 4:
      case 5:
        cut_.erase(server.bus->server());
        return servers_.engine.mend(server.bus->inner());
      case 6:
      case 7:
        isStopped_ = below(6) == 0;
        return isStopped_ ? servers_.engine.stop() : servers_.engine.start();
      case 8:
        return servers_.engine.slow(std::chrono::milliseconds(below(40)), std::chrono::milliseconds(below(below(4) == 0 ? 1500 : 40)));
      case 9:
        if (below(3) != 0 || servers_.servers.size() < 2) return;
        for (const auto& [id, hearer] : server.members) gone(id);
        for (std::size_t k = 0; k < servers_.servers.size(); ++k)
          if (&servers_.servers[k] == &server) return servers_.crash(k);
        return;
      case 10:
        if (servers_.servers.size() < 4) servers_.start();
        return;
      case 11:
        if (kind_ != Kind::kSteps) servers_.engine.setClock(std::chrono::milliseconds(below(20'000)));
        if (kind_ == Kind::kLosesRecords && below(3) == 0) servers_.engine.loseRecords();
        return;
      case 12:
      case 13:
        if (member) server.clock->receive(member->first, wire::SetClock{below(6) != 0, mode(), static_cast<double>(below(20)), 0});
        return;
      default:
        step();
    }
  }
  ClockMode mode() { return kind_ == Kind::kSteps ? ClockMode::kStepped : static_cast<ClockMode>(below(3)); }

  // By the owner, where that is. The n-th takes 2^n microseconds: as many steps were taken as the time has bits, if each was taken once.
  void step() {
    for (Server& server : servers_.servers)
      for (const auto& [id, hearer] : server.members)
        if (server.clock->state().owner == id && steps_ < 31) {
          server.clock->step(id, {std::uint64_t{1} << steps_++, below(3) != 0});
          return;
        }
  }

  void gone(std::uint64_t member) {
    gone_.insert(member);
    --members_;
  }

  void advance(SimulatedTimer::Time::duration by) {
    for (const auto end = servers_.timer.now() + by; servers_.timer.step(end);) judge();
    judge();
    servers_.shown();
    for (Server& server : servers_.servers)
      for (const auto& [id, hearer] : server.members)
        if (!hearer->clocks.empty() && hearer->isAwaited(id) && below(3) != 0) {
          done_.insert({id, hearer->last().step});
          server.clock->receive(id, wire::StepDone{hearer->last().step});
        }
  }

  void judge() {
    for (Server& server : servers_.servers) {
      const bool isUnheard = isStopped_ || cut_.contains(server.bus->server()) || server.bus->isAway();
      for (const auto& [id, hearer] : server.members) {
        if (isUnheard) unheard_.insert(id);  // and may be dropped
        for (std::size_t& k = read_[hearer.get()]; k < hearer->clocks.size(); ++k) judge(hearer->clocks[k]);
      }
    }
  }
  void judge(const wire::Clock& clock) {
    if (kind_ == Kind::kSteps) {
      ASSERT_EQ(static_cast<std::uint64_t>(std::popcount(clock.time)), clock.step) << "a step was taken twice";
    }
    if (kind_ == Kind::kLosesRecords) return;
    if (clock.notice.starts_with("Member "))  // N was passed over
      unheard_.insert(std::stoull(clock.notice.substr(7)));
    if (clock.step > newest_) {
      for (const std::uint64_t member : awaited_)
        EXPECT_TRUE(done_.contains({member, newest_}) || gone_.contains(member) || unheard_.contains(member))
            << "step " << clock.step << " began before member " << member << " was done with " << newest_;
      newest_ = clock.step;
      awaited_.clear();
    }
    if (clock.step == newest_) awaited_.insert(clock.waitsFor.begin(), clock.waitsFor.end());
  }

  std::mt19937_64 random_;
  const Kind kind_;
  Servers servers_;
  std::uint64_t lastMember_ = 0, members_ = 0, steps_ = 0, newest_ = 0;
  bool isStopped_ = false;
  std::set<std::uint32_t> cut_;
  std::set<std::uint64_t> awaited_, gone_, unheard_;  // with the newest step; members that left; of servers that were cut off
  std::set<std::pair<std::uint64_t, std::uint64_t>> done_;
  std::map<const Hearer*, std::size_t> read_;
};

class SharedClockLaws : public testing::TestWithParam<Course::Kind> {};
TEST_P(SharedClockLaws, HoldForRandomCourses) {
  for (std::uint64_t seed = 1; seed <= 100 && !HasFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Course(seed, GetParam()).run();
  }
}
INSTANTIATE_TEST_SUITE_P(Kinds, SharedClockLaws, testing::Values(Course::Kind::kSteps, Course::Kind::kRuns, Course::Kind::kLosesRecords));

}  // namespace
}  // namespace ridgecast::clock
