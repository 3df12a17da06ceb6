#pragma once
// A session's timer that stands still until a test moves it.

#include <map>
#include <utility>

#include "server/session/timer.h"

namespace ridgecast::testing_support {

// One thread.
class SimulatedTimer final : public session::Timer {
 public:
  Time now() const override { return now_; }
  void at(Time when, std::function<void()> call) const override { calls_.emplace(when, std::move(call)); }

  // Runs what is due on the way, in order.
  void advance(Time::duration by) {
    const Time end = now_ + by;
    while (!calls_.empty() && calls_.begin()->first <= end) {
      const auto next = calls_.extract(calls_.begin());
      now_ = std::max(now_, next.key());
      next.mapped()();
    }
    now_ = end;
  }
  std::size_t pending() const { return calls_.size(); }

 private:
  Time now_{std::chrono::hours(1)};
  mutable std::multimap<Time, std::function<void()>> calls_;
};

}  // namespace ridgecast::testing_support
