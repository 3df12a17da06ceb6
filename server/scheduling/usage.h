#pragma once
// How many threads have been at work lately: a mean whose weight falls by e every kMemory, as that of a system's load average, but of
// seconds. It needs no sampling: the number is constant between two changes. Private to the room. Not thread-safe.

#include <chrono>
#include <cmath>

namespace ridgecast::scheduling {

class Usage {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::chrono::seconds kMemory{5};

  // From now on so many are at work.
  void set(unsigned working, Time now) {
    mean_ = mean(now);
    since_ = now;
    working_ = working;
  }
  double mean(Time now) const {
    const double passed = std::chrono::duration<double>(now - since_) / kMemory;
    return working_ + (mean_ - working_) * std::exp(-passed);
  }

 private:
  double mean_ = 0;  // at since_
  unsigned working_ = 0;
  Time since_{};
};

}  // namespace ridgecast::scheduling
