#pragma once
// The room's synchronisation and timing primitives: the system's. A test substitutes its own (RIDGECAST_CONTROLLED_THREADS), so that it
// decides which thread continues at every lock, wait, notification and atomic, and can try all orders. Private to the room.
#ifndef RIDGECAST_CONTROLLED_THREADS

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <ctime>
#include <mutex>
#include <thread>

#include "server/scheduling/usage.h"

namespace ridgecast::scheduling {

using Mutex = std::mutex;
using Condition = std::condition_variable;
using Thread = std::thread;
template <class T>
using Atomic = std::atomic<T>;

inline std::chrono::nanoseconds threadCpuTime() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec);
}

inline std::chrono::steady_clock::time_point currentTime() { return std::chrono::steady_clock::now(); }

// An idle thread spins this long before it sleeps: an iteration is a series of short loops, and waking a thread takes longer.
inline constexpr std::chrono::microseconds kSpin{100};

inline void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#else
  std::this_thread::yield();
#endif
}

// Whether the condition came to hold meanwhile.
template <class Predicate>
bool spinUntil(const Predicate& condition) {
  const auto end = std::chrono::steady_clock::now() + kSpin;
  do {
    for (int k = 0; k < 16; ++k) {
      if (condition()) return true;
      pause();
    }
  } while (std::chrono::steady_clock::now() < end);
  return false;
}

}  // namespace ridgecast::scheduling

#endif
