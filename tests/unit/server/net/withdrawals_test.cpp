// What one server's file has lost is refused by the others, until they read their own.
#include "server/net/withdrawals.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::net {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;

struct Server {
  Server(SimulatedEngine& engine, const SimulatedTimer& timer) : bus(engine.connect()) {
    withdrawals = std::make_shared<Withdrawals>(
        bus, timer, [this](const auto& hashes) { refused.insert(refused.end(), hashes.begin(), hashes.end()); });
    withdrawals->loaded({});
    withdrawals->begin();
  }
  std::shared_ptr<bus::Bus> bus;
  std::vector<std::string> refused;
  std::shared_ptr<Withdrawals> withdrawals;
};

TEST(Withdrawals, ReachEveryOtherServerOnceAndWithinTwoSeconds) {
  SimulatedTimer timer;
  SimulatedEngine engine(timer);
  Server a(engine, timer), b(engine, timer), c(engine, timer);
  timer.advance(5s);
  a.withdrawals->loaded({"one", "two"});
  timer.advance(2s);
  EXPECT_THAT(b.refused, ElementsAre("one", "two"));
  EXPECT_THAT(c.refused, ElementsAre("one", "two"));
  EXPECT_THAT(a.refused, IsEmpty());
  timer.advance(60s);
  EXPECT_EQ(b.refused.size(), 2u) << "not again and again";
}

TEST(Withdrawals, ReachAServerThatWasAwayUnlessItHasReadItsFileSince) {
  SimulatedTimer timer;
  SimulatedEngine engine(timer);
  Server a(engine, timer), b(engine, timer), c(engine, timer);
  timer.advance(5s);
  engine.cut(*b.bus);
  engine.cut(*c.bus);
  a.withdrawals->loaded({"one"});
  timer.advance(300s);
  c.withdrawals->loaded({});
  engine.mend(*b.bus);
  engine.mend(*c.bus);
  timer.advance(10s);
  EXPECT_THAT(b.refused, ElementsAre("one"));
  EXPECT_THAT(c.refused, IsEmpty()) << "its own file decides";
  Server late(engine, timer);
  timer.advance(5s);
  EXPECT_THAT(late.refused, IsEmpty());
}

TEST(Withdrawals, OfManyTokensComeWhole) {
  SimulatedTimer timer;
  SimulatedEngine engine(timer);
  Server a(engine, timer), b(engine, timer);
  timer.advance(1s);
  Withdrawals::Hashes many;
  for (std::size_t k = 0; k < 2 * Withdrawals::kAtATime + 1; ++k) many.push_back("hash" + std::to_string(k));
  a.withdrawals->loaded(many);
  timer.advance(2s);
  EXPECT_THAT(b.refused, testing::UnorderedElementsAreArray(many));
}

}  // namespace
}  // namespace ridgecast::net
