// The simulated engine keeps the laws, and its faults are what they are named.
#include <gmock/gmock.h>

#include "tests/support/simulated_bus.h"
#include "tests/unit/server/bus/laws.h"

namespace ridgecast::bus {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;
using Kind = Appended::Kind;

class Simulated final : public EngineUnderTest {
 public:
  explicit Simulated(std::chrono::milliseconds delay, std::chrono::milliseconds notice) {
    engine_.slow(delay, delay);
    engine_.notice(notice);
  }
  std::shared_ptr<Bus> connect() override { return engine_.connect(); }
  bool await(const std::function<bool()>& so) override {
    for (const auto end = timer_.now() + 1min; !so();) {
      if (timer_.now() >= end) return false;
      timer_.advance(1ms);
    }
    return true;
  }
  void stop() override { engine_.stop(); }
  void start() override { engine_.start(); }
  void prepareLoss() override {}
  void loseEnd(const std::string& log, std::size_t entries) override { engine_.loseEnd(log, entries); }
  void fill() override { engine_.fill(); }
  void empty() override { engine_.empty(); }

 private:
  SimulatedTimer timer_;
  SimulatedEngine engine_{timer_};
};

INSTANTIATE_TEST_SUITE_P(Simulated, LawsOfTheBus, testing::Values([] { return std::make_unique<Simulated>(0ms, 0ms); }));
INSTANTIATE_TEST_SUITE_P(SimulatedAndSlow, LawsOfTheBus, testing::Values([] { return std::make_unique<Simulated>(10ms, 500ms); }));

struct Two {
  SimulatedTimer timer;
  SimulatedEngine engine{timer};
  std::shared_ptr<Bus> a = engine.connect(), b = engine.connect();
};

TEST(SimulatedEngine, CutsOneServerOff) {
  Two t;
  const Heard<std::string> heard;
  const auto hearing = t.b->hear("channel", heard.take());
  const Heard<std::uint64_t> changed;
  const auto watching = t.a->watch("log", changed.take());
  t.timer.advance(0ms);
  t.engine.cut(*t.a);
  EXPECT_TRUE(t.a->isAway());
  EXPECT_FALSE(t.b->isAway());
  t.a->tell("channel", "lost");
  const Answer<Appended> appended, refused;
  t.b->append("log", 0, {"one"}, Bus::Origin::kNew, appended.take());
  t.a->append("log", 0, {"no"}, Bus::Origin::kNew, refused.take());
  t.timer.advance(1s);
  EXPECT_EQ(appended.get().kind, Kind::kDone);
  EXPECT_EQ(refused.get().kind, Kind::kAway);
  EXPECT_EQ(changed.last(), 0u);
  t.engine.mend(*t.a);
  t.timer.advance(0ms);
  EXPECT_FALSE(t.a->isAway());
  EXPECT_EQ(changed.last(), 1u);
  EXPECT_THAT(heard.all(), IsEmpty());
}

// Both happen over the seeds; the server learns neither.
TEST(SimulatedEngine, LosesOrKeepsWhatWasOnItsWay) {
  int kept = 0, lost = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    SimulatedTimer timer;
    SimulatedEngine engine(timer, seed);
    const auto a = engine.connect();
    engine.slow(10ms);
    const Answer<Appended> first, second;
    a->append("log", 0, {"one"}, Bus::Origin::kNew, first.take());
    a->append("log", 1, {"two"}, Bus::Origin::kNew, second.take());
    timer.advance(5ms);
    engine.cut(*a);
    timer.advance(1s);
    EXPECT_EQ(first.get().kind, Kind::kUnknown);
    EXPECT_EQ(second.get().kind, Kind::kUnknown);
    const auto log = engine.log("log");
    (log.empty() ? lost : kept) += 1;
    if (!log.empty()) {
      EXPECT_EQ(log[0].bytes, "one");  // never the second alone
    }
  }
  EXPECT_GT(kept, 5);
  EXPECT_GT(lost, 5);
}

TEST(SimulatedEngine, TakesABrokenConnectionForASlowOneForAWhile) {
  Two t;
  t.engine.notice(2s);
  t.engine.cut(*t.a);
  const Answer<Appended> appended;
  t.a->append("log", 0, {"one"}, Bus::Origin::kNew, appended.take());
  t.timer.advance(1999ms);
  EXPECT_FALSE(t.a->isAway());
  EXPECT_FALSE(appended.has());
  t.timer.advance(1ms);
  EXPECT_TRUE(t.a->isAway());
  EXPECT_EQ(appended.get().kind, Kind::kUnknown);
  EXPECT_THAT(t.engine.log("log"), IsEmpty());
}

TEST(SimulatedEngine, HasItsOwnClock) {
  Two t;
  const std::int64_t begin = t.a->now();
  t.engine.cut(*t.a);
  t.timer.advance(3s);
  EXPECT_EQ(t.a->now(), begin + 3'000'000);
  t.engine.setClock(-1s);
  EXPECT_EQ(t.b->now(), begin + 2'000'000);
}

TEST(SimulatedEngine, CallsNoHandlerOfABusThatIsGone) {
  Two t;
  t.engine.slow(10ms);
  const Answer<Appended> appended;
  const Heard<std::uint64_t> changed;
  const auto watching = t.a->watch("log", changed.take());
  t.a->append("log", 0, {"one"}, Bus::Origin::kNew, appended.take());
  t.timer.advance(15ms);  // the engine has it; the answer is on its way
  t.a.reset();
  t.timer.advance(1s);
  EXPECT_FALSE(appended.has());
  EXPECT_THAT(changed.all(), IsEmpty());
  EXPECT_EQ(t.engine.log("log").size(), 1u);
  EXPECT_EQ(t.engine.traffic().entries, 1u);
}

}  // namespace
}  // namespace ridgecast::bus
