#pragma once
// One parallel loop's body, as pool.cpp calls it: rests where another executor goes first, and keeps the first exception for the caller.
// Private to the room.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <thread>

namespace ridgecast::scheduling {

// Of loops whose executor gives way to another: how much work comes before a rest, and the longest rest.
inline constexpr std::chrono::microseconds kWorkAtATime{500}, kLongestRest{50'000};
inline constexpr int kRests = 9;  // times what was worked: others then lose a tenth at most
inline thread_local std::chrono::steady_clock::time_point rested{};

// Rests kRests times as long as was worked since the last time.
inline void rest(const std::atomic<unsigned>& others) {
  const auto now = std::chrono::steady_clock::now();
  if (now - rested < kWorkAtATime) return;
  if (others.load(std::memory_order_relaxed) > 0)
    std::this_thread::sleep_for(std::min<std::chrono::steady_clock::duration>(kRests * (now - rested), kLongestRest));
  rested = std::chrono::steady_clock::now();
}

class Loop {
 public:
  // `others`: threads that work for the executor that goes first; null: none does.
  Loop(const std::function<void(std::size_t)>& task, const std::atomic<unsigned>* others) : task_(task), others_(others) {}

  // After a failure, what has not begun is passed over.
  void operator()(std::size_t k) noexcept {
    if (others_) rest(*others_);
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
  const std::atomic<unsigned>* const others_;
  std::atomic<bool> failed_{false};
  std::exception_ptr failure_;
};

}  // namespace ridgecast::scheduling
