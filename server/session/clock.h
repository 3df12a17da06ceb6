#pragma once
// A session's clock: real time, scaled, or stepped by its owner. What time it is is a function of what was said to it and of the time of
// day that is handed in; it neither waits nor sends. Not thread-safe.
//
// It begins in real time, at 0, without an owner. Whoever sets it while it has none becomes its owner; only the owner sets or steps it.
// When the owner leaves, the clock goes on as it is (a stepped one stands still) until somebody else takes it.
//
// A step may wait: the next one does not begin before every member that followed the clock when it began has done it or has left. Steps
// that come meanwhile queue up, at most kMaxQueuedSteps; they are forgotten with their owner or when the mode changes.

#include <chrono>
#include <cstdint>
#include <deque>
#include <set>

#include "common/wire/messages.h"

namespace ridgecast::session {

class Clock {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  static constexpr std::size_t kMaxQueuedSteps = 64;

  explicit Clock(Instant now) : since_(now) {}

  wire::Clock state(Instant now) const;
  std::uint64_t time(Instant now) const;  // microseconds
  std::uint64_t owner() const { return owner_; }

  // A member that follows the clock comes; any member goes. Whether the state changed.
  void follow(std::uint64_t member) { followers_.insert(member); }
  bool leave(std::uint64_t member, Instant now);

  // Whether the state changed: not when it is another's.
  bool set(std::uint64_t member, const wire::SetClock& set, Instant now);
  enum class Stepped { kBegins, kQueues, kNotYours, kNotStepped, kTooMany };
  Stepped step(std::uint64_t member, const wire::Step& step);
  bool done(std::uint64_t member, std::uint64_t step);

 private:
  void begin(const wire::Step& step);
  void goOn();  // to the next queued steps, when nobody is waited for

  Instant since_;           // when it was time_
  std::uint64_t time_ = 0;  // microseconds
  wire::ClockMode mode_ = wire::ClockMode::kRealTime;
  double rate_ = 1;
  std::uint64_t owner_ = 0, step_ = 0;
  std::set<std::uint64_t> followers_, waitsFor_;
  std::deque<wire::Step> queued_;
};

}  // namespace ridgecast::session
