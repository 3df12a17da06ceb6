#include "server/clock/clock.h"

#include <algorithm>

#include "common/outcome/contract.h"

namespace ridgecast::clock {

void Clock::play(const wire::Clock& recording, Instant now) {
  state_.since = now;
  state_.end = recording.end;
  state_.time = upToEnd(recording.time);
  state_.mode = recording.mode;
  state_.rate = recording.rate;
}

std::uint64_t Clock::upToEnd(std::uint64_t time) const { return std::min(state_.end == 0 ? wire::kMaxTime : state_.end, time); }

std::uint64_t Clock::movedTo(std::uint64_t time) const {
  return std::max(state_.time, state_.end == 0 ? std::min(kMaxMoved, time) : upToEnd(time));
}

bool Clock::isTooFarAhead(std::uint64_t time, Instant now) const {
  return state_.end == 0 && time > std::min(kMaxMoved, this->time(now) + wire::kMaxStepTime);
}

std::uint64_t Clock::time(Instant now) const {
  if (state_.mode == wire::ClockMode::kStepped) return state_.time;
  const double passed = std::max(0.0, std::chrono::duration<double, std::micro>(now - state_.since).count()) * state_.rate;
  return upToEnd(state_.time + static_cast<std::uint64_t>(std::min(passed, 1e18)));
}

wire::Clock Clock::state(Instant now) const {
  wire::Clock out;
  out.mode = state_.mode;
  out.rate = state_.rate;
  out.time = time(now);
  out.owner = state_.owner;
  out.step = state_.step;
  out.end = state_.end;
  out.waitsFor.assign(state_.waitsFor.begin(), state_.waitsFor.end());
  return out;
}

bool Clock::leave(std::uint64_t member, Instant) {
  state_.followers.erase(member);
  state_.passedOver.erase(member);
  bool changed = state_.waitsFor.erase(member) > 0;
  if (state_.owner == member) {
    state_.owner = 0;
    state_.queued.clear();
    changed = true;
  }
  if (changed) goOn();
  return changed;
}

bool Clock::set(std::uint64_t member, const wire::SetClock& set, Instant now) {
  if (state_.owner != 0 && state_.owner != member) return false;
  if (!set.own) {
    if (state_.owner == 0) return false;
    state_.owner = 0;
    state_.queued.clear();
    return true;
  }
  state_.owner = member;
  state_.time = time(now);
  state_.since = now;
  if (set.mode != wire::ClockMode::kStepped) {
    state_.queued.clear();
    state_.waitsFor.clear();
  }
  state_.mode = set.mode;
  state_.rate = state_.mode == wire::ClockMode::kRealTime ? 1 : state_.mode == wire::ClockMode::kScaled ? set.rate : 0;
  if (state_.waitsFor.empty() && !isTooFarAhead(set.time, now)) state_.time = movedTo(set.time);
  return true;
}

Clock::Stepped Clock::step(std::uint64_t member, const wire::ClockStep& step) {
  if (state_.owner != member) return Stepped::kNotYours;
  if (state_.mode != wire::ClockMode::kStepped) return Stepped::kNotStepped;
  if (state_.queued.size() >= kMaxQueuedSteps) return Stepped::kTooMany;
  state_.queued.push_back(step);
  const std::uint64_t before = state_.step;
  goOn();
  return state_.step != before ? Stepped::kBegins : Stepped::kQueues;
}

bool Clock::done(std::uint64_t member, std::uint64_t step) {
  if (step != state_.step) return false;
  if (state_.passedOver.erase(member) > 0) follow(member);
  if (state_.waitsFor.erase(member) == 0) return false;
  if (!state_.waitsFor.empty()) return false;  // a change matters only when nobody is waited for any more
  goOn();
  return true;
}

bool Clock::passOver(std::uint64_t member) {
  if (state_.followers.erase(member) == 0) return false;
  state_.passedOver.insert(member);
  state_.waitsFor.erase(member);
  goOn();
  return true;
}

bool Clock::reach(std::uint64_t time, Instant now) {
  if (this->time(now) >= time) return false;
  state_.time = upToEnd(time);
  state_.since = now;
  return true;
}

void Clock::begin(const wire::ClockStep& step) {
  expects(state_.mode == wire::ClockMode::kStepped && state_.waitsFor.empty(),
          "a step begins on a stepped clock when nobody is waited for");
  ++state_.step;
  state_.time = movedTo(state_.time + step.time);
  if (!step.wait) return;
  state_.waitsFor = state_.followers;
  state_.waitsFor.erase(state_.owner);  // nobody waits for the owner
}

void Clock::goOn() {
  while (state_.waitsFor.empty() && !state_.queued.empty()) {
    begin(state_.queued.front());
    state_.queued.pop_front();
  }
}

}  // namespace ridgecast::clock
