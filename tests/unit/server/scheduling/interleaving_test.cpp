// Whom the executor wakes and when, in all orders in which its threads can go on, with the executor's own code. In reports, thread 1 of an
// executor of two or more is the one for short tasks.
#include "tests/unit/server/scheduling/interleaving.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#define RIDGECAST_CONTROLLED_THREADS
namespace ridgecast::scheduling {
using interleaving::Atomic;
using interleaving::Condition;
using interleaving::Mutex;
using interleaving::Thread;
inline std::chrono::nanoseconds threadCpuTime() { return interleaving::cpuTime(); }
inline std::chrono::steady_clock::time_point currentTime() { return {}; }
struct Usage {  // decides nothing, and its times would make each state a new one
  void set(unsigned, std::chrono::steady_clock::time_point) {}
  static double mean(std::chrono::steady_clock::time_point) { return 0; }
};
// Threads may go on before each look: looking once can turn out in all ways in which looking for a while can.
template <class Predicate>
bool spinUntil(const Predicate& condition) {
  return condition();
}
}  // namespace ridgecast::scheduling
#include "server/scheduling/pool.cpp"  // NOLINT(bugprone-suspicious-include)

namespace ridgecast::scheduling {
namespace {

using interleaving::begin;
using interleaving::expect;
using interleaving::until;
using testing::HasSubstr;

void tryAll(const std::function<void()>& scenario) {
  const auto report = interleaving::tryAll(scenario, &workingFor, {"work", "shortWork", "a loop's"});
  EXPECT_TRUE(report.trouble.empty()) << report.trouble;
  EXPECT_GT(report.states, 100u) << "the scenario begins";
  testing::Test::RecordProperty("states", std::to_string(report.states));
}

// So that the executor knows its tasks as short.
void makeShort(Pool& pool) {
  int done = 0;
  for (int k = 1; k <= 8; ++k) {
    pool.post([&] { ++done; });
    until([&] { return done == k; }, "the task is done");
  }
}

// What the checker itself says of code that is wrong.
std::string troubleOf(const std::function<void()>& scenario) {
  const void* none = nullptr;
  return interleaving::tryAll(scenario, &none, {"the bell", "another", "another"}).trouble;
}

struct Bell {
  Mutex mutex;
  Condition rung;
  bool isRung = false;
  void await(bool looks) {
    std::unique_lock lock(mutex);
    if (!looks || !isRung) rung.wait(lock);
  }
  void ring(bool locks) {
    std::unique_lock lock(mutex);
    isRung = true;
    if (!locks) lock.unlock();
    rung.notify_one();
  }
};

TEST(Checker, FindsNothingInWhatIsRight) {
  EXPECT_EQ(troubleOf([] {
              Bell bell;
              Thread sleeper([&] { bell.await(true); });
              begin();
              bell.ring(true);
              sleeper.join();
            }),
            "");
}

TEST(Checker, FindsAWakeUpThatIsLost) {
  const std::string trouble = troubleOf([] {
    Bell bell;
    begin();
    Thread sleeper([&] { bell.await(false); });
    bell.ring(true);
    sleeper.join();
  });
  EXPECT_THAT(trouble, HasSubstr("Nothing leads to the end"));
  EXPECT_THAT(trouble, HasSubstr("the first thread: joins thread 1"));
}

TEST(Checker, FindsANotificationWithoutTheLock) {
  EXPECT_THAT(troubleOf([] {
                Bell bell;
                Thread sleeper([&] { bell.await(true); });
                begin();
                bell.ring(false);
                sleeper.join();
              }),
              HasSubstr("notifies without the lock"));
}

TEST(Checker, FindsWhatIsLeft) {
  std::shared_ptr<int> kept;
  EXPECT_THAT(troubleOf([&] {
                begin();
                new (&kept) std::shared_ptr<int>(std::make_shared<int>());  // never let go of
              }),
              HasSubstr("left allocated"));
  new (&kept) std::shared_ptr<int>();
}

TEST(Checker, TriesAllOrdersAndEachOnce) {
  const void* none = nullptr;
  int outcomes = 0;  // as bits
  const auto report = interleaving::tryAll(
      [&] {
        Atomic<int> value = 0;
        begin();
        Thread other([&] { value = value + 1; });
        value = value + 1;
        other.join();
        outcomes |= 1 << value;
      },
      &none, {"", "", ""});
  EXPECT_EQ(report.trouble, "");
  EXPECT_EQ(outcomes, 1 << 1 | 1 << 2) << "an increment is lost in some order";
}

TEST(Interleaving, WhatAShortTaskLeavesBehindIsBegun) {
  tryAll([] {
    Executor executor(2);
    const auto one = executor.makePool(), other = executor.makePool(), edits = executor.makePool(1);
    makeShort(*edits);
    int done = 0;
    const auto task = [&] { ++done; };
    begin();
    one->post(task);
    other->post(task);
    edits->post(task);
    edits->post(task);
    until([&] { return done == 4; }, "all is done");
  });
}

TEST(Interleaving, ShortTasksDoNotWaitForLongOnes) {
  tryAll([] {
    Executor executor(2);
    const auto one = executor.makePool(), other = executor.makePool(), quick = executor.makePool(1);
    makeShort(*quick);
    int done = 0;
    const auto task = [&] { until([&] { return done == 2; }, "the short ones are done"); };
    begin();
    one->post(task);
    other->post(task);
    quick->post([&] { ++done; });
    quick->post([&] { ++done; });
    until([&] { return done == 2; }, "the short ones are done");
  });
}

TEST(Interleaving, AShortTaskBeginsThoughItsPoolWasQueuedForALoop) {
  tryAll([] {
    Executor executor(2);
    const auto one = executor.makePool(), other = executor.makePool(), quick = executor.makePool(2);
    makeShort(*quick);
    int begun = 0;
    bool done = false;
    const auto task = [&] {
      ++begun;
      until([&] { return done; }, "the short one is done");
    };
    one->post(task);
    other->post(task);
    until([&] { return begun == 2; }, "the long ones have begun");
    begin();
    Thread outside([&] { quick->forEach(2, 1, [](std::size_t) {}); });
    quick->post([&] { done = true; });
    outside.join();
    until([&] { return done; }, "the short one is done");
  });
}

// Returns when so many have come.
void meet(int& come, int count) {
  ++come;
  until([&come, count] { return come >= count; }, "the others have come");
}

TEST(Interleaving, TasksOfOnePoolMeet) {
  tryAll([] {
    int come = 0;
    Executor executor(2);
    const auto pool = executor.makePool(2);
    begin();
    for (int k = 0; k < 2; ++k) pool->post([&] { meet(come, 2); });
    until([&] { return come == 2; }, "both have come");
  });
}

TEST(Interleaving, TasksOfTwoPoolsMeet) {
  tryAll([] {
    int come = 0;
    Executor executor(2);
    const auto one = executor.makePool(1), other = executor.makePool(1);
    begin();
    for (const auto& pool : {one, other}) pool->post([&] { meet(come, 2); });
    until([&] { return come == 2; }, "both have come");
  });
}

TEST(Interleaving, TurnsOfALoopMeet) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2);
    int outside = 0, inside = 0;
    begin();
    pool->forEach(2, 1, [&](std::size_t) { meet(outside, 2); });
    pool->post([&] { pool->forEach(2, 1, [&](std::size_t) { meet(inside, 2); }); });
    until([&] { return inside == 2; }, "the turns inside have met");
  });
}

TEST(Interleaving, FollowersInALoopMeet) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2);
    int come = 0;
    begin();
    pool->forEachOrdered({{}, {0}, {0}, {1, 2}}, [&](std::size_t k) {
      if (k == 1 || k == 2) meet(come, 2);
    });
    expect(come == 2, "each once");
  });
}

TEST(Interleaving, AHelperThatLeavesForOthersPassesTheLoopOn) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2), other = executor.makePool(2);
    int done = 0;
    begin();
    pool->forEachOrdered({{}, {0}}, [&](std::size_t k) {
      for (int n = 0; n < 2 && k == 0; ++n) other->post([&] { until([&] { return done == 2; }, "the loop has ended"); });
      ++done;
    });
  });
}

TEST(Interleaving, ALoopWaitsForWhatIsMissing) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2);
    int sum = 0;
    begin();
    pool->forEachOrdered({{}, {}, {0, 1}, {2}}, [&](std::size_t k) {
      interleaving::point();
      sum += static_cast<int>(k);
    });
    expect(sum == 6, "each once");
  });
}

TEST(Interleaving, LoopsOfTwoThreadsLeaveRoomForATask) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2);
    int done = 0;
    begin();
    Thread outside([&] { pool->forEach(2, 1, [&](std::size_t) { ++done; }); });
    pool->forEach(2, 1, [&](std::size_t) { ++done; });
    pool->post([&] { ++done; });
    outside.join();
    until([&] { return done == 5; }, "all is done");
  });
}

TEST(Interleaving, DestructionEndsWhateverIsQueued) {
  tryAll([] {
    std::shared_ptr<Pool> one, other;
    Executor executor(2);
    one = executor.makePool(1);
    other = executor.makePool(1);
    begin();
    one->post([&] { other->post([] {}); });
    one->post([] {});
  });
}

TEST(Interleaving, DestructionEndsAmidALoop) {
  tryAll([] {
    std::shared_ptr<Pool> pool;
    Executor executor(2);
    pool = executor.makePool(2);
    begin();
    pool->post([&] { pool->forEachOrdered({{}, {0}, {0}}, [](std::size_t) {}); });
  });
}

TEST(Interleaving, ATaskMayHoldTheLastReferenceToItsPool) {
  tryAll([] {
    int done = 0;
    Executor executor(2);
    begin();
    auto pool = executor.makePool(2);
    auto* const raw = pool.get();
    raw->post([&done, own = std::move(pool)] { own->post([&done] { ++done; }); });
  });
}

TEST(Interleaving, WhoIsRousedFindsWhatComes) {
  tryAll([] {
    Executor executor(2);
    const auto pool = executor.makePool(2), other = executor.makePool(1);
    int done = 0, come = 0;
    begin();
    pool->wakeOne();
    other->post([&] {
      until([&] { return come == 2; }, "the turns have met");
      ++done;
    });
    pool->forEach(2, 1, [&](std::size_t) { meet(come, 2); });
    until([&] { return done == 1; }, "the task is done");
  });
}

TEST(Interleaving, TasksOfOneThreadCallEachOther) {
  tryAll([] {
    Executor executor(1);
    const auto one = executor.makePool(), other = executor.makePool();
    int done = 0;
    begin();
    one->post([&] { ++done, other->post([&] { ++done, one->post([&] { ++done; }); }); });
    other->post([&] { ++done; });
    until([&] { return done == 4; }, "all are done");
  });
}

}  // namespace
}  // namespace ridgecast::scheduling
