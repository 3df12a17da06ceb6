#pragma once
// Times are the machine's: tests wait until something is so, and assert times only when MEASURE is set in the environment, on a machine
// that does nothing else.

#include <chrono>
#include <cstdlib>
#include <thread>

namespace ridgecast::testing_support {

inline constexpr std::chrono::seconds kTimeout{120};  // only there to end what hangs

inline bool measures() { return std::getenv("MEASURE") != nullptr; }

// Until it is so; false: it never was.
template <class Condition>
bool await(const Condition& so, std::chrono::milliseconds timeout = kTimeout) {
  const auto end = std::chrono::steady_clock::now() + timeout;
  while (!so()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return true;
}

}  // namespace ridgecast::testing_support
