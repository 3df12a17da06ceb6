#pragma once
// A session's timer that stands still until a test moves it.

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "server/scheduling/timer.h"

namespace ridgecast::testing_support {

// One thread moves it; any thread reads it and schedules calls.
class SimulatedTimer final : public scheduling::Timer {
 public:
  Time now() const override {
    const std::lock_guard lock(mutex_);
    return now_;
  }
  void at(Time when, std::function<void()> call) const override {
    const std::lock_guard lock(mutex_);
    calls_.emplace(when, std::move(call));
  }

  // Runs what is due on the way, in order.
  void advance(Time::duration by) {
    for (const Time end = now() + by; step(end);) {
    }
  }
  // Moves to the next call that is due by `end`, and runs it. False: there was none, and it is `end`.
  bool step(Time end) {
    std::unique_lock lock(mutex_);
    if (calls_.empty() || calls_.begin()->first > end) {
      now_ = std::max(now_, end);
      return false;
    }
    const auto next = calls_.extract(calls_.begin());
    now_ = std::max(now_, next.key());
    lock.unlock();
    next.mapped()();
    return true;
  }
  std::size_t pending() const {
    const std::lock_guard lock(mutex_);
    return calls_.size();
  }

 private:
  mutable std::mutex mutex_;
  Time now_{std::chrono::hours(1)};
  mutable std::multimap<Time, std::function<void()>> calls_;
};

}  // namespace ridgecast::testing_support
