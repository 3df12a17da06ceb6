#pragma once
// Tries all orders in which threads can go on: a model checker whose model is the code itself.
//
// Threads, locks, conditions and atomics have the names of server/scheduling/threads.h. One real thread runs them all and switches between
// their stacks: at each lock, notification and atomic, every thread that can go on does, in one order or another. A state is what lies in
// memory, the stacks and what the threads allocated. Each state is visited once, and the end must be reachable from each. So a report
// names the first step after which nothing helps any more, by a shortest way to it.
//
// Laws: who notifies holds the lock; at the end nothing is left allocated. Not modelled: weak memory orders, and sleepers that wake without
// a notification.

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

namespace ridgecast::interleaving {

inline constexpr std::size_t kThreads = 8, kMaxStates = 1'000'000;

// The functions and classes are for the threads of a scenario, tryAll() alone is not.

// Another thread may go on here. `what`: a line of the report; null: none.
void point(const char* what = nullptr);
// Waits until the condition, which has no points, holds.
void until(const std::function<bool()>& condition, const char* what);
// The others go on until they sleep. From then on all orders are tried; before, one.
void begin();
// A law of the scenario.
void expect(bool holds, const char* law);
// Of the calling thread: what it has spent.
std::chrono::nanoseconds cpuTime();
void spend(std::chrono::nanoseconds time);

class Mutex {
 public:
  void lock();
  void unlock();

 private:
  friend struct Scheduler;
  friend class Condition;
  std::size_t owner_ = kThreads;  // kThreads: nobody
};

class Condition {
 public:
  Condition();
  void wait(std::unique_lock<Mutex>& lock);
  template <class Predicate>
  void wait(std::unique_lock<Mutex>& lock, const Predicate& holds) {
    while (!holds()) wait(lock);
  }
  void notify_one();  // NOLINT(readability-identifier-naming): as std's; any of those that sleep
  void notify_all();  // NOLINT(readability-identifier-naming)

 private:
  friend struct Scheduler;
  unsigned number_;  // how many were made before it, at most kNamed
};

class Thread {
 public:
  template <class Body>
  explicit Thread(Body body) : number_(start(new std::function<void()>(std::move(body)))) {}
  void join() const;

 private:
  static std::size_t start(const std::function<void()>* body);
  std::size_t number_;
};

template <class Value>
class Atomic {
 public:
  Atomic(Value value) : value_(value) {}  // NOLINT(google-explicit-constructor): as std's
  Atomic(const Atomic&) = delete;
  Atomic& operator=(const Atomic&) = delete;

  Value load(std::memory_order = std::memory_order_seq_cst) const { return point(), value_; }
  operator Value() const { return load(); }  // NOLINT(google-explicit-constructor)
  Value exchange(Value value) { return point(), std::exchange(value_, value); }
  Value operator=(Value value) { return exchange(value), value; }  // NOLINT(misc-unconventional-assign-operator): as std's
  Value fetch_add(Value by, std::memory_order = std::memory_order_seq_cst) { return point(), std::exchange(value_, value_ + by); }
  Value fetch_sub(Value by, std::memory_order = std::memory_order_seq_cst) { return point(), std::exchange(value_, value_ - by); }
  Value operator++() { return fetch_add(1) + 1; }
  Value operator--() { return fetch_sub(1) - 1; }

 private:
  Value value_;
};

inline constexpr unsigned kNamed = 2;
using Names = std::array<const char*, kNamed + 1>;

struct Report {
  std::size_t states = 0, steps = 0;
  std::string trouble;  // empty: none. Else what is wrong, a shortest order that leads there, and where all are then
};

// `scenario` is the first thread's body. At the end all threads have ended, and nothing is left allocated. `perThread`: the code's
// thread_local pointer. `conditions`: names for the report of those that are made first; the last name is of all others.
Report tryAll(const std::function<void()>& scenario, const void** perThread, const Names& conditions);

}  // namespace ridgecast::interleaving
