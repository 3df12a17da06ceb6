#pragma once
// Why a mesh could not be made, in one sentence for a person, and whose matter that is.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <stop_token>
#include <string>

#include <boost/assert/source_location.hpp>
#include <boost/system/result.hpp>

namespace ridgecast::box {

struct Problem {
  enum class Kind {
    kNotThere,  // no such camera, or it holds nothing yet
    kTooMuch,   // beyond a limit; the sentence says which and what would fit
    kTooSlow,   // the time was up: less, or later
    kStopped,   // nobody waits any more
    kFailed,    // the server's own fault
  };
  Kind kind = Kind::kFailed;
  std::string message;
};

[[noreturn]] inline void throw_exception_from_error(const Problem& p, const boost::source_location&) {
  throw std::runtime_error(p.message);
}

template <class T>
using Result = boost::system::result<T, Problem>;

// Whether the work should go on. Any thread.
struct Watch {
  std::stop_token stop;
  std::chrono::steady_clock::time_point deadline;
  double seconds = 0;                               // that there were, for messages
  std::atomic<std::uint32_t>* triangles = nullptr;  // where it is told how many there are, if anywhere

  void has(std::uint32_t count) const {
    if (triangles) triangles->store(count, std::memory_order_relaxed);
  }
  bool over() const { return stop.stop_requested() || std::chrono::steady_clock::now() >= deadline; }
  Problem problem() const;  // what to say when it is over
};

}  // namespace ridgecast::box
