#pragma once
// Why a mesh could not be made, in one sentence for people, and who can change that.

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
    kTooMuch,   // beyond a limit; the sentence names it and what would fit
    kTooSlow,   // timed out: request less, or try later
    kStopped,   // nobody is waiting any more
    kFailed,    // an error of the server
  };
  Kind kind = Kind::kFailed;
  std::string message;
  double error = 0;  // kTooMuch of a box: metres, about what would fit; 0: unknown, for the box's sides take too much
};

[[noreturn]] inline void throw_exception_from_error(const Problem& p, const boost::source_location&) {
  throw std::runtime_error(p.message);
}

template <class T>
using Result = boost::system::result<T, Problem>;

// How far the work is. Written while it goes on; any thread may read it meanwhile.
struct Progress {
  std::atomic<std::uint32_t> triangles{0}, checked{0};  // so far; of the box's own check
};

// Whether the work should continue. Any thread.
struct Watch {
  std::stop_token stop;
  std::chrono::steady_clock::time_point deadline;
  double seconds = 0;            // the time limit, for messages
  Progress* progress = nullptr;  // may be null

  void has(std::uint32_t triangles) const {
    if (progress) progress->triangles.store(triangles, std::memory_order_relaxed);
  }
  void checks(std::uint32_t triangles) const {
    if (progress) progress->checked.fetch_add(triangles, std::memory_order_relaxed);
  }
  bool over() const { return stop.stop_requested() || std::chrono::steady_clock::now() >= deadline; }
  Problem problem() const;  // what to report when it is over
};

// Of a box, in metres: more than `most` triangles, where an error of about `fits` would do (0: unknown); more than `most` heights; a step
// in the ground beyond the lattice.
Problem tooManyTriangles(double error, std::uint32_t most, double fits);
Problem tooRough(double error, std::uint64_t most);
Problem tooSteep(double step);

}  // namespace ridgecast::box
