#pragma once
// A session's clock: real time, scaled, or stepped by its owner. Its time depends only on the calls made and on the time of day passed in;
// it neither waits nor sends. Not thread-safe.
//
// It starts at 0, in real time or stepped, without an owner. The first member to set it becomes its owner; only the owner sets or steps it.
// When the owner leaves, the clock continues as it is (a stepped one stands still) until another member takes it.
//
// A step may wait: the next one starts only when every member that followed the clock at its start has done it, left or been passed over.
// Meanwhile further steps queue up, at most kMaxQueuedSteps. Owner or mode changes drop them, and the clock does not jump.
//
// Time does not go back. A recording's clock begins anywhere in it and stands at its end.

#include <chrono>
#include <cstdint>
#include <deque>
#include <set>
#include <utility>

#include "common/wire/messages.h"
#include "common/wire/wire.h"

namespace ridgecast::clock {

class Clock {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  static constexpr std::size_t kMaxQueuedSteps = 64;
  static constexpr std::uint64_t kMaxMoved = wire::kMaxTime / 2;  // by jumps and steps, so that it can always run: 142 years

  // All that a clock is: one made of another's goes on as that one would.
  struct State {
    Instant since{};         // the instant at which the clock showed `time`
    std::uint64_t time = 0;  // microseconds
    std::uint64_t end = 0;   // of a recording; 0: there is none
    wire::ClockMode mode = wire::ClockMode::kRealTime;
    double rate = 1;
    std::uint64_t owner = 0, step = 0;
    std::set<std::uint64_t> followers{}, waitsFor{}, passedOver{};  // each member is in one of the first and last at most
    std::deque<wire::ClockStep> queued{};
  };

  explicit Clock(Instant now, wire::ClockMode mode = wire::ClockMode::kRealTime)
      : state_{.since = now, .mode = mode, .rate = mode == wire::ClockMode::kStepped ? 0.0 : 1.0} {}
  explicit Clock(State state) : state_(std::move(state)) {}
  const State& all() const { return state_; }

  // Before anybody follows it: time, mode, rate and end of a recording's.
  void play(const wire::Clock& recording, Instant now);

  wire::Clock state(Instant now) const;
  std::uint64_t time(Instant now) const;  // microseconds
  std::uint64_t owner() const { return state_.owner; }
  std::uint64_t step() const { return state_.step; }  // number of the newest
  const std::set<std::uint64_t>& waitsFor() const { return state_.waitsFor; }

  // A member starts to follow the clock, or leaves (follower or not). Returns whether the state changed.
  void follow(std::uint64_t member) { state_.followers.insert(member); }
  bool leave(std::uint64_t member, Instant now);

  // Of a jump: by more than kMaxStepTime, or beyond kMaxMoved, and the clock is not a recording's.
  bool isTooFarAhead(std::uint64_t time, Instant now) const;

  // Returns whether the state changed; it does not if the clock belongs to another member. An earlier time is ignored, and so is one
  // too far ahead.
  bool set(std::uint64_t member, const wire::SetClock& set, Instant now);
  enum class Stepped { kBegins, kQueues, kNotYours, kNotStepped, kTooMany };
  Stepped step(std::uint64_t member, const wire::ClockStep& step);
  bool done(std::uint64_t member, std::uint64_t step);
  // No step waits for this follower until it is done with the newest. False: it is no follower, or was passed over before.
  bool passOver(std::uint64_t member);
  // Somebody was shown this time: it is shown at least that. Returns whether the state changed.
  bool reach(std::uint64_t time, Instant now);

 private:
  std::uint64_t upToEnd(std::uint64_t time) const;
  std::uint64_t movedTo(std::uint64_t time) const;  // the time after a step or a jump
  void begin(const wire::ClockStep& step);
  void goOn();  // to the next queued steps, if nobody is waited for

  State state_;
};

}  // namespace ridgecast::clock
