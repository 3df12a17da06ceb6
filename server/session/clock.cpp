#include "server/session/clock.h"

#include <algorithm>

#include "common/outcome/contract.h"

namespace ridgecast::session {

void Clock::play(const wire::Clock& recording, Instant now) {
  since_ = now;
  end_ = recording.end;
  time_ = upToEnd(recording.time);
  mode_ = recording.mode;
  rate_ = recording.rate;
}

std::uint64_t Clock::upToEnd(std::uint64_t time) const { return std::min(end_ == 0 ? wire::kMaxTime : end_, time); }

std::uint64_t Clock::movedTo(std::uint64_t time) const { return std::max(time_, end_ == 0 ? std::min(kMaxMoved, time) : upToEnd(time)); }

bool Clock::isTooFarAhead(std::uint64_t time, Instant now) const {
  return end_ == 0 && time > std::min(kMaxMoved, this->time(now) + wire::kMaxStepTime);
}

std::uint64_t Clock::time(Instant now) const {
  if (mode_ == wire::ClockMode::kStepped) return time_;
  const double passed = std::max(0.0, std::chrono::duration<double, std::micro>(now - since_).count()) * rate_;
  return upToEnd(time_ + static_cast<std::uint64_t>(std::min(passed, 1e18)));
}

wire::Clock Clock::state(Instant now) const {
  wire::Clock out;
  out.mode = mode_;
  out.rate = rate_;
  out.time = time(now);
  out.owner = owner_;
  out.step = step_;
  out.end = end_;
  out.waitsFor.assign(waitsFor_.begin(), waitsFor_.end());
  return out;
}

bool Clock::leave(std::uint64_t member, Instant) {
  followers_.erase(member);
  passedOver_.erase(member);
  bool changed = waitsFor_.erase(member) > 0;
  if (owner_ == member) {
    owner_ = 0;
    queued_.clear();
    changed = true;
  }
  if (changed) goOn();
  return changed;
}

bool Clock::set(std::uint64_t member, const wire::SetClock& set, Instant now) {
  if (owner_ != 0 && owner_ != member) return false;
  if (!set.own) {
    if (owner_ == 0) return false;
    owner_ = 0;
    queued_.clear();
    return true;
  }
  owner_ = member;
  time_ = time(now);
  since_ = now;
  if (set.mode != wire::ClockMode::kStepped) {
    queued_.clear();
    waitsFor_.clear();
  }
  mode_ = set.mode;
  rate_ = mode_ == wire::ClockMode::kRealTime ? 1 : mode_ == wire::ClockMode::kScaled ? set.rate : 0;
  if (waitsFor_.empty() && !isTooFarAhead(set.time, now)) time_ = movedTo(set.time);
  return true;
}

Clock::Stepped Clock::step(std::uint64_t member, const wire::ClockStep& step) {
  if (owner_ != member) return Stepped::kNotYours;
  if (mode_ != wire::ClockMode::kStepped) return Stepped::kNotStepped;
  if (queued_.size() >= kMaxQueuedSteps) return Stepped::kTooMany;
  queued_.push_back(step);
  const std::uint64_t before = step_;
  goOn();
  return step_ != before ? Stepped::kBegins : Stepped::kQueues;
}

bool Clock::done(std::uint64_t member, std::uint64_t step) {
  if (step != step_) return false;
  if (passedOver_.erase(member) > 0) follow(member);
  if (waitsFor_.erase(member) == 0) return false;
  if (!waitsFor_.empty()) return false;  // a change matters only when nobody is waited for any more
  goOn();
  return true;
}

bool Clock::passOver(std::uint64_t member) {
  if (followers_.erase(member) == 0) return false;
  passedOver_.insert(member);
  waitsFor_.erase(member);
  goOn();
  return true;
}

void Clock::begin(const wire::ClockStep& step) {
  expects(mode_ == wire::ClockMode::kStepped && waitsFor_.empty(), "a step begins on a stepped clock when nobody is waited for");
  ++step_;
  time_ = movedTo(time_ + step.time);
  if (!step.wait) return;
  waitsFor_ = followers_;
  waitsFor_.erase(owner_);  // nobody waits for the owner
}

void Clock::goOn() {
  while (waitsFor_.empty() && !queued_.empty()) {
    begin(queued_.front());
    queued_.pop_front();
  }
}

}  // namespace ridgecast::session
