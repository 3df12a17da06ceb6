#include "server/scheduling/pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <future>
#include <latch>
#include <mutex>
#include <new>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>
#include <thread>

#include "tests/support/waiting.h"

namespace ridgecast::scheduling {
namespace {

using namespace std::chrono_literals;

void spinFor(std::chrono::microseconds time) {
  const auto end = std::chrono::steady_clock::now() + time;
  while (std::chrono::steady_clock::now() < end) {
  }
}

// Runs f as a task of the pool and waits for it.
void runOn(Pool& pool, const std::function<void()>& f) {
  auto done = std::make_shared<std::promise<void>>();
  ASSERT_TRUE(pool.post([&f, done] {
    f();
    done->set_value();
  }));
  done->get_future().wait();
}

Order randomOrder(std::mt19937& random, std::size_t count, unsigned most) {
  Order order(count);
  for (std::size_t k = 1; k < count; ++k) {
    std::set<std::uint32_t> before;
    for (unsigned n = random() % (most + 1); n > 0; --n) before.insert(static_cast<std::uint32_t>(random() % k));
    order[k].assign(before.begin(), before.end());
  }
  return order;
}

class Threads : public testing::TestWithParam<unsigned> {};
INSTANTIATE_TEST_SUITE_P(Executors, Threads, testing::Values(1u, 2u, 3u, 8u));

TEST_P(Threads, WhatALoopThrowsReachesItsCallerAlone) {
  Executor executor(GetParam());
  auto pool = executor.makePool(), other = executor.makePool();
  std::mt19937 random(5);
  const auto fails = [](std::size_t k) {
    if (k % 7 == 3) throw std::bad_alloc();
  };
  for (int round = 0; round < 20; ++round) {
    EXPECT_THROW(pool->forEach(1000, 3, fails), std::bad_alloc);
    EXPECT_THROW(pool->forEachOrdered(randomOrder(random, 300, 3), fails), std::bad_alloc);
    EXPECT_THROW(pool->forEach(1, 1, [](std::size_t) { throw std::runtime_error("one"); }), std::runtime_error);
    runOn(*pool, [&] { EXPECT_THROW(pool->forEach(1000, 3, fails), std::bad_alloc); });
    std::atomic<int> done = 0;
    for (Pool* p : {pool.get(), other.get()}) p->forEach(100, 2, [&](std::size_t) { ++done; });
    EXPECT_EQ(done, 200);
  }
}

TEST_P(Threads, ForEachVisitsEveryIndexOnceFromOutsideAndFromATask) {
  Executor executor(GetParam());
  auto pool = executor.makePool();
  for (const std::size_t count : {0u, 1u, 2u, 7u, 64u, 1000u})
    for (const std::size_t grain : {0u, 1u, 3u, 64u, 5000u}) {
      for (const bool fromTask : {false, true}) {
        std::vector<int> visits(count, 0);  // plain: each index has one writer, and forEach publishes it
        const auto loop = [&] { pool->forEach(count, grain, [&](std::size_t k) { ++visits[k]; }); };
        if (fromTask) {
          runOn(*pool, loop);
        } else {
          loop();
        }
        EXPECT_EQ(std::count(visits.begin(), visits.end(), 1), static_cast<std::ptrdiff_t>(count));
      }
    }
}

TEST_P(Threads, OrderedTasksSeeAllTheirPredecessors) {
  Executor executor(GetParam());
  auto pool = executor.makePool(8);
  std::mt19937 random(7);
  for (int round = 0; round < 30; ++round) {
    const std::size_t count = random() % 400;
    const Order order = randomOrder(random, count, round % 6);
    // Plain memory: a missing happens-before would be a data race and, most likely, a wrong sum.
    std::vector<std::uint64_t> value(count, 0), expected(count, 0);
    for (std::size_t k = 0; k < count; ++k) {
      expected[k] = k + 1;
      for (const auto p : order[k]) expected[k] += expected[p] * 3;
    }
    const auto body = [&](std::size_t k) {
      std::uint64_t sum = k + 1;
      for (const auto p : order[k]) sum += value[p] * 3;
      value[k] += sum;
    };
    if (round % 2) {
      runOn(*pool, [&] { pool->forEachOrdered(order, body); });
    } else {
      pool->forEachOrdered(order, body);
    }
    EXPECT_EQ(value, expected);
  }
}

TEST_P(Threads, NestedLoopsInTasksOfManyPoolsFinish) {
  std::atomic<int> visits{0};
  std::latch done(18);
  Executor executor(GetParam());
  std::vector<std::shared_ptr<Pool>> pools;
  for (int k = 0; k < 6; ++k) pools.push_back(executor.makePool(1 + k % 4));
  for (int round = 0; round < 3; ++round)
    for (auto& pool : pools)
      ASSERT_TRUE(pool->post([&, own = pool] {
        own->forEach(8, 1, [&](std::size_t) {
          own->forEach(8, 2, [&](std::size_t) { ++visits; });
          own->forEachOrdered(Order{{}, {0}, {0}, {1, 2}}, [&](std::size_t) { ++visits; });
        });
        done.count_down();
      }));
  done.wait();
  EXPECT_EQ(visits, 18 * 8 * (8 + 4));
}

TEST(Scheduling, ReadyTasksStartInAscendingOrder) {
  // With one worker for the tasks, ascending order is the only one.
  Executor executor(4);
  auto pool = executor.makePool(1);
  std::mt19937 random(3);
  const Order order = randomOrder(random, 200, 3);
  std::vector<std::size_t> ran;
  pool->forEachOrdered(order, [&](std::size_t k) { ran.push_back(k); });
  std::vector<std::size_t> expected(200);
  std::iota(expected.begin(), expected.end(), 0);
  EXPECT_EQ(ran, expected);
}

TEST(Scheduling, KeepsToTheLimitOfTasksInFlight) {
  std::atomic<unsigned> now{0}, most{0};
  Executor executor(6);
  for (const unsigned limit : {1u, 2u, 3u}) {
    auto pool = executor.makePool(limit);
    const auto body = [&](std::size_t) {
      const unsigned mine = ++now;
      unsigned seen = most;
      while (mine > seen && !most.compare_exchange_weak(seen, mine)) {
      }
      spinFor(20us);
      --now;
    };
    most = 0;
    auto done = std::make_shared<std::latch>(40);  // shared: the last count-down may still be returning when the wait ends
    for (int k = 0; k < 40; ++k)
      ASSERT_TRUE(pool->post([&body, done] {
        body(0);
        done->count_down();
      }));
    done->wait();
    EXPECT_LE(most, limit);
    runOn(*pool, [&] { pool->forEach(200, 1, body); });
    pool->forEach(200, 1, body);
    pool->forEachOrdered(Order(200), body);
    EXPECT_LE(most, limit);
  }
}

TEST(Scheduling, UsesSeveralThreads) {
  Executor executor(4);
  auto pool = executor.makePool(4);
  std::mutex mutex;
  std::condition_variable changed;
  std::set<std::thread::id> threads;
  const auto end = std::chrono::steady_clock::now() + testing_support::kTimeout;
  // Each index that has nothing to wait for waits for the others' threads.
  const auto note = [&](std::size_t) {
    std::unique_lock lock(mutex);
    threads.insert(std::this_thread::get_id());
    changed.notify_all();
    changed.wait_until(lock, end, [&] { return threads.size() >= 3; });
  };
  pool->forEach(60, 1, note);
  EXPECT_GE(threads.size(), 3u);
  threads.clear();
  pool->forEachOrdered(Order(60), note);
  EXPECT_GE(threads.size(), 3u);
  // Work that fans out only later finds its helpers again.
  threads.clear();
  Order funnel(80);
  for (std::uint32_t k = 1; k < 20; ++k) funnel[k] = {k - 1};
  for (std::uint32_t k = 20; k < 80; ++k) funnel[k] = {19};
  pool->forEachOrdered(funnel, [&](std::size_t k) {
    if (k >= 20) note(k);
  });
  EXPECT_GE(threads.size(), 3u);
}

TEST(Scheduling, ManyPoolsShareFairly) {
  constexpr int kPools = 200;
  std::vector<std::shared_ptr<Pool>> pools;
  std::vector<std::atomic<int>> counts(kPools);
  std::atomic<bool> stop{false};
  std::vector<std::function<void()>> tasks(kPools);
  Executor executor(2);  // last, so that its tasks end before what they use
  // Every pool always has work; the first also floods its queue and fans out.
  for (int k = 0; k < kPools; ++k) {
    pools.push_back(executor.makePool());
    tasks[k] = [&, k] {
      if (k == 0)
        pools[0]->forEach(4, 1, [](std::size_t) { spinFor(5us); });
      else
        spinFor(20us);
      ++counts[k];
      if (!stop) pools[k]->post(tasks[k]);
    };
  }
  for (int k = 0; k < kPools; ++k)
    for (int n = 0; n < (k == 0 ? 500 : 2); ++n) ASSERT_TRUE(pools[k]->post(tasks[k]));
  EXPECT_TRUE(testing_support::await(
      [&] { return std::accumulate(counts.begin(), counts.end(), 0L, [](long n, const auto& c) { return n + c; }) > 100L * kPools; }));
  stop = true;
  double sum = 0, squares = 0;
  int least = counts[0];
  for (auto& c : counts) {
    sum += c;
    squares += double(c) * c;
    least = std::min(least, c.load());
  }
  EXPECT_GT(least, 0);
  EXPECT_GT(sum * sum / (kPools * squares), 0.9);  // Jain's index: 1 is perfectly fair
}

// Whoever has many pools waits no less for whoever has one, and leaves nothing behind.
TEST(Scheduling, ClientsTakeTurns) {
  Executor executor{Executor::WithoutThreads{}};
  std::string order;
  for (int round = 0; round < 2; ++round) {
    order.clear();
    std::vector<std::shared_ptr<Pool>> many;
    for (int k = 0; k < 4; ++k) many.push_back(executor.makePool(0, "many"));
    const auto one = executor.makePool(0, "one"), nobodys = executor.makePool(), other = executor.makePool();
    for (int n = 0; n < 2; ++n)
      for (std::size_t k = 0; k < many.size(); ++k) ASSERT_TRUE(many[k]->post([&order, k] { order += std::to_string(k); }));
    for (const auto& [pool, name] : {std::pair(one, 'a'), std::pair(nobodys, 'b'), std::pair(other, 'c')})
      for (int n = 0; n < 3; ++n) ASSERT_TRUE(pool->post([&order, name = name] { order += name; }));
    executor.work();
    EXPECT_EQ(order, "0abc1abc2abc30123");
  }
}

TEST(Scheduling, WithoutThreadsAllIsDoneByWhoCalls) {
  Executor executor{Executor::WithoutThreads{}};
  const auto one = executor.makePool(), other = executor.makePool();
  std::string order;
  ASSERT_TRUE(one->post([&] {
    order += 'a';
    other->post([&] { order += 'c'; });
  }));
  ASSERT_TRUE(other->post([&] {
    other->forEach(3, 1, [&](std::size_t k) { order += std::to_string(k); });
    order += 'b';
  }));
  one->forEach(2, 1, [&](std::size_t) { order += '-'; });
  EXPECT_EQ(order, "--");
  EXPECT_EQ(executor.queued(), 2u);
  executor.work();
  EXPECT_EQ(order, "--a012bc");
  EXPECT_EQ(executor.queued(), 0u);
  executor.work();
  EXPECT_EQ(order, "--a012bc");
}

TEST(Scheduling, UsageIsTheShareOfThreadsAtWorkLately) {
  using testing_support::await;
  std::promise<void> release;
  Executor executor(2);
  auto pool = executor.makePool();
  EXPECT_EQ(executor.usage(), 0);
  ASSERT_TRUE(pool->post([gate = release.get_future().share()] { gate.wait(); }));
  EXPECT_TRUE(await([&] { return executor.usage() > 0.1; }));
  const double once = executor.usage();
  EXPECT_LE(once, 0.5) << "one of two threads";
  release.set_value();
  EXPECT_TRUE(await([&] { return executor.usage() < once / 2; }));
}

TEST(Scheduling, QueueOfPostedTasksIsBounded) {
  std::atomic<int> ran{0};
  std::promise<void> release, started;
  Executor executor(1);
  auto pool = executor.makePool();
  auto gate = release.get_future().share();
  ASSERT_TRUE(pool->post([&] {
    started.set_value();
    gate.wait();
  }));
  started.get_future().wait();
  int accepted = 0;
  while (pool->post([&] { ++ran; })) ++accepted;
  EXPECT_EQ(accepted, 1024);
  release.set_value();
  while (ran < accepted) std::this_thread::yield();
  EXPECT_TRUE(pool->post([] {}));
}

TEST(Scheduling, DroppedTasksAreDestroyedAndLateOnesRefused) {
  auto token = std::make_shared<int>(0);
  std::shared_ptr<Pool> pool;
  {
    Executor executor(1);
    pool = executor.makePool();
    auto started = std::make_shared<std::promise<void>>();
    pool->post([started] {
      started->set_value();
      std::this_thread::sleep_for(20ms);
    });
    started->get_future().wait();
    for (int k = 0; k < 10; ++k) pool->post([token, pool] {});  // each would keep its own pool alive
  }
  EXPECT_EQ(token.use_count(), 1);
  EXPECT_EQ(pool.use_count(), 1);
  EXPECT_FALSE(pool->post([token] {}));
}

using SchedulingDeathTest = testing::Test;
TEST(SchedulingDeathTest, ATaskThatThrowsEndsTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(
      {
        Executor executor(1);
        auto pool = executor.makePool();
        pool->post([] { throw 1; });
        std::this_thread::sleep_for(testing_support::kTimeout);
      },
      "");
}

// A tenth of all cores and no more, while the other one works, even where a core is free.
TEST(Executors, WhoRestsKeepsToItsShare) {
  std::atomic<bool> over{false};
  Executor first(1), second(2, &first, 0.1);  // last, so that its tasks end before what they use
  const auto busy = first.makePool();
  busy->post([&] {
    while (!over) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  const auto pool = second.makePool(2);
  const auto cpu = [] {
    timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
  };
  std::atomic<double> worked{0};
  const auto begin = std::chrono::steady_clock::now();
  pool->forEach(100, 1, [&](std::size_t) {
    const double from = cpu();
    double now = from;
    while (now < from + 0.002) now = cpu();
    worked += now - from;
  });
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  over = true;
  EXPECT_GE(worked, 0.2);
  EXPECT_LE(worked / took.count(), 1.2 * 0.1 * std::thread::hardware_concurrency());
}

// However busy the executor that goes first is: everything is done once, in an order that is right, and never without end.
TEST(Executors, WhoRestsWhileAnotherWorksComesToItsEnd) {
  std::atomic<bool> over{false};
  Executor first(1), second(2, &first, 0.5);  // last, so that its tasks end before what they use
  const auto busy = first.makePool();
  busy->post([&] {
    while (!over) std::this_thread::yield();
  });
  const auto pool = second.makePool(2);
  std::vector<std::atomic<int>> done(64);
  pool->forEach(done.size(), 4, [&](std::size_t k) {
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    ++done[k];
  });
  for (const auto& count : done) EXPECT_EQ(count, 1);
  Order order(32);
  for (std::uint32_t k = 1; k < order.size(); ++k) order[k] = {k - 1};
  std::vector<std::size_t> came;
  pool->forEachOrdered(order, [&](std::size_t k) { came.push_back(k); });
  EXPECT_TRUE(std::is_sorted(came.begin(), came.end()));
  EXPECT_EQ(came.size(), order.size());
  over = true;
}

}  // namespace
}  // namespace ridgecast::scheduling
