#pragma once
// The session's clock, in window and page: what is shown, and what buttons and keys request of the server. A client owns it only for a
// request, so that everybody may drive it. Values only.

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "client/core/conversation/roster.h"
#include "client/core/conversation/session_clock.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

inline constexpr double kSlowestClock = 0.25, kFastestClock = 16;  // session seconds a second
inline constexpr std::int64_t kClockSkip = 10'000'000;             // microseconds

struct ClockBar {
  bool on = false;
  bool known = false;               // the server has told of a clock
  bool jumps = false;               // it may be set to a time (World::revision)
  std::uint64_t time = 0, end = 0;  // microseconds; end: of a recording, otherwise 0
  bool runs = true;
  double rate = 1;                    // that it runs at, or goes on with
  std::string driver{};               // the other member that owns it; empty: none
  std::optional<float> dragged = {};  // seconds, where the slider is held
  bool isOver() const { return end != 0 && time >= end; }

  // `others`: the other members.
  void hear(const SessionClock& clock, const wire::World& world, const std::map<std::uint64_t, Other>& others, SessionClock::Instant now);
  // Why it cannot be set so, as a sentence; empty: it can.
  std::string refusal(const wire::SetClock& set) const;
  // It was set: the next key, maybe pressed before the server answers, builds on that.
  void goOn(const wire::SetClock& set);
};

std::string clockText(std::uint64_t microseconds);  // "1:02.3", "1:00:02.3"; tenths, rounded down
std::string rateText(double rate);                  // "0.25 x"

// Time 0: no jump.
wire::SetClock setTo(bool runs, double rate, std::uint64_t time);
// Pauses or resumes it; a finished recording restarts.
wire::SetClock toggled(const ClockBar& clock);
// Twice as fast, or half.
wire::SetClock faster(const ClockBar& clock, bool isFaster);
// By this much, no further than the beginning and the end. Only recordings go back.
wire::SetClock movedBy(const ClockBar& clock, std::int64_t microseconds);
wire::SetClock movedTo(const ClockBar& clock, std::uint64_t microseconds);

}  // namespace ridgecast::core
