#pragma once
// A session's clock on several servers, over a simulated engine: hours in milliseconds, the same course for the same seed.
#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/clock/session_clock.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::clock {

using namespace std::chrono_literals;
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

inline constexpr wire::SetClock kStepped{true, ClockMode::kStepped, 0};

}  // namespace ridgecast::clock
