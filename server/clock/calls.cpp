#include "server/clock/calls.h"

#include <utility>

namespace ridgecast::clock {

namespace {

std::string whyNotYours(const Clock& clock) {
  if (clock.owner() == 0) return "Nobody owns the clock: take it with set clock first.";
  return "The clock belongs to member " + std::to_string(clock.owner()) + ": only its owner sets and steps it.";
}

Effect setClock(Clock& clock, std::uint64_t member, const wire::SetClock& set, Clock::Instant now) {
  Effect effect;
  effect.isChanged = clock.set(member, set, now);
  effect.goesBack = effect.isChanged && set.own && set.time != 0 && set.time < clock.time(now);
  if (!effect.isChanged)
    effect.notices.push_back({member, whyNotYours(clock), true});
  else if (effect.goesBack)
    effect.notices.push_back({member, "Time goes back only in recordings.", true});
  else if (set.own && clock.isTooFarAhead(set.time, now))
    effect.notices.push_back({member, "A jump takes the clock at most an hour ahead, and to at most 142 years.", true});
  return effect;
}

Effect passOverAsAsked(Clock& clock, std::uint64_t member, std::uint64_t late) {
  if (clock.owner() != member) return {.notices = {{member, whyNotYours(clock), true}}};
  Effect effect = passOver(clock, late, "by the clock's owner");
  if (!effect.isChanged)
    effect.notices = {
        {member, "No step waits for member " + std::to_string(late) + ": it does not follow the clock or was passed over before.", true}};
  return effect;
}

}  // namespace

std::string sentenceOf(Clock::Stepped stepped) {
  switch (stepped) {
    case Clock::Stepped::kNotStepped:
      return "A step came while the clock runs by itself; set it to stepped first.";
    case Clock::Stepped::kTooMany:
      return "More than " + std::to_string(Clock::kMaxQueuedSteps) +
             " steps wait for the members: send the next when the clock says that one has begun.";
    case Clock::Stepped::kBegins:
    case Clock::Stepped::kQueues:
    case Clock::Stepped::kNotYours:
      break;
  }
  return {};
}

Effect apply(Clock& clock, const Call& call, Clock::Instant now) {
  Effect effect;
  switch (call.kind) {
    case Call::Kind::kFollow:
      clock.follow(call.member);
      break;
    case Call::Kind::kLeave:
      effect.isChanged = clock.leave(call.member, now);
      break;
    case Call::Kind::kSet:
      return setClock(clock, call.member, call.set, now);
    case Call::Kind::kStep:
      effect.stepped = clock.step(call.member, call.step);
      effect.isChanged = effect.stepped == Clock::Stepped::kBegins;
      if (std::string why = effect.stepped == Clock::Stepped::kNotYours ? whyNotYours(clock) : sentenceOf(effect.stepped); !why.empty())
        effect.notices.push_back({call.member, std::move(why), true});
      break;
    case Call::Kind::kDone:
      effect.isChanged = clock.done(call.member, call.number);
      break;
    case Call::Kind::kPassOver:
      return passOverAsAsked(clock, call.member, call.number);
    case Call::Kind::kReach:
      effect.isChanged = clock.reach(call.number, now);
      break;
  }
  return effect;
}

std::string whyLate() { return "because it was not done within " + std::to_string(kStepTimeout.count()) + " s"; }

Effect passOver(Clock& clock, std::uint64_t member, const std::string& why) {
  const std::string notice = "Member " + std::to_string(member) + " was passed over at step " + std::to_string(clock.step()) + ", " + why +
                             "; when it is done with the newest step, steps wait for it again.";
  if (!clock.passOver(member)) return {};
  Effect effect{.isChanged = true, .notices = {{member, notice}}};
  if (clock.owner() != 0 && clock.owner() != member) effect.notices.push_back({clock.owner(), notice});
  return effect;
}

}  // namespace ridgecast::clock
