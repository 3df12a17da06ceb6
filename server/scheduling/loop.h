#pragma once
// One parallel loop's body, as pool.cpp calls it: rests where another executor goes first, and keeps the first exception for the caller.
// Private to the room.

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <thread>

#include "server/scheduling/threads.h"

namespace ridgecast::scheduling {

// The executor that loops give way to.
struct Courtesy {
  const Atomic<unsigned>* others = nullptr;  // threads that work for the executor that goes first; null: there is none
  double rests = 0;                          // duration of a rest, as a multiple of the work, while there are others

  // Of the calling thread's work, in or between loops, since it was last here.
  void rest() const {
    constexpr std::chrono::microseconds kWorkAtATime{500}, kLongest{250'000};
    thread_local std::chrono::steady_clock::time_point looked{};
    thread_local std::chrono::nanoseconds rested{};
    if (!others || std::chrono::steady_clock::now() - looked < kWorkAtATime) return;
    const auto worked = threadCpuTime() - rested;  // CPU time: on a busy machine the thread has waited long enough
    if (worked >= kWorkAtATime && others->load(std::memory_order_relaxed) > 0)
      std::this_thread::sleep_for(std::min<std::chrono::duration<double>>(rests * worked, kLongest));
    rested = threadCpuTime();
    looked = std::chrono::steady_clock::now();
  }
};

class Loop {
 public:
  Loop(const std::function<void(std::size_t)>& task, const Courtesy& courtesy) : task_(task), courtesy_(courtesy) {}

  // After a failure, tasks that have not begun are skipped.
  void operator()(std::size_t k) noexcept {
    courtesy_.rest();
    if (failed_.load(std::memory_order_relaxed)) return;
    try {
      task_(k);
    } catch (...) {
      if (!failed_.exchange(true)) failure_ = std::current_exception();
    }
  }

  // Call when all have ended.
  void rethrow() {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  const std::function<void(std::size_t)>& task_;
  const Courtesy& courtesy_;
  Atomic<bool> failed_{false};
  std::exception_ptr failure_;
};

}  // namespace ridgecast::scheduling
