#pragma once
// What members say to a session's clock, as values; and what comes of each.

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/wire/messages.h"
#include "server/clock/clock.h"

namespace ridgecast::clock {

struct Call {
  enum class Kind : std::uint8_t { kFollow, kLeave, kSet, kStep, kDone, kPassOver, kReach };
  Kind kind = Kind::kFollow;
  std::uint64_t member = 0;
  wire::SetClock set{};      // kSet
  wire::ClockStep step{};    // kStep
  std::uint64_t number = 0;  // kDone: of the step; kPassOver: the member; kReach: the time, as Clock::reach
};

// One sentence for the people at a member.
struct Notice {
  std::uint64_t member = 0;
  std::string sentence;
  bool isRefusal = false;  // the member's last call has no effect
};

struct Effect {
  bool isChanged = false;  // the clock, so that followers are notified
  Clock::Stepped stepped = Clock::Stepped::kQueues;
  bool goesBack = false;          // a time was asked for that is before the clock's
  std::vector<Notice> notices{};  // if the call had no effect, its member's is the first
};

Effect apply(Clock& clock, const Call& call, Clock::Instant now);
inline constexpr std::chrono::seconds kStepTimeout{30};  // then a step's late members are passed over
// Passes it over, with sentences for it and the owner. `why`: "by ...", "because ...".
Effect passOver(Clock& clock, std::uint64_t member, const std::string& why);

std::string whyLate();
// Why a step of the clock's owner was not taken; empty if it was.
std::string sentenceOf(Clock::Stepped stepped);

}  // namespace ridgecast::clock
