#include "client/core/hands/clock_bar.h"

#include <algorithm>
#include <cstdio>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::core {

wire::SetClock setTo(bool runs, double rate, std::uint64_t time) {
  using enum wire::ClockMode;
  expects(rate > 0, "a clock that stands keeps the rate that it goes on with");
  return {true, !runs ? kStepped : rate == 1 ? kRealTime : kScaled, rate, time};
}

void ClockBar::hear(const SessionClock& clock, const wire::World& world, const std::map<std::uint64_t, Other>& others,
                    SessionClock::Instant now) {
  const wire::Clock& said = clock.said();
  if (!known) on = said.end != 0;  // whoever looks at a recording wants it
  known = true;
  jumps = world.revision >= 6;
  end = said.end;
  if (clock.isSettled()) {
    time = clock.time(now);
    runs = said.rate > 0;
    if (runs) rate = said.rate;
  }
  driver.clear();
  if (said.owner == 0 || said.owner == world.camera) return;
  const auto owner = others.find(said.owner);
  driver = owner != others.end() ? nameOf(owner->second.member) : "Member " + std::to_string(said.owner);
}

std::string ClockBar::refusal(const wire::SetClock& set) const {
  if (!known) return "No connection to a server with a clock.";
  if (set.time != 0 && !jumps) return "This server is too old to set its clock to a time.";
  return driver.empty() ? "" : driver + " owns the clock.";
}

void ClockBar::goOn(const wire::SetClock& set) {
  runs = set.mode != wire::ClockMode::kStepped;
  rate = set.rate;
  if (set.time != 0) time = set.time;
}

std::string clockText(std::uint64_t microseconds) {
  const auto tenths = static_cast<unsigned long long>(microseconds / 100'000), minutes = tenths / 600;
  char text[48];
  if (minutes < 60)
    std::snprintf(text, sizeof text, "%llu:%02llu.%llu", minutes, tenths / 10 % 60, tenths % 10);
  else
    std::snprintf(text, sizeof text, "%llu:%02llu:%02llu.%llu", minutes / 60, minutes % 60, tenths / 10 % 60, tenths % 10);
  return text;
}

std::string rateText(double rate) {
  char text[24];
  std::snprintf(text, sizeof text, "%.3g x", rate);
  return text;
}

wire::SetClock toggled(const ClockBar& clock) {
  if (clock.isOver()) return setTo(true, clock.rate, 1);
  return setTo(!clock.runs, clock.rate, 0);
}

wire::SetClock faster(const ClockBar& clock, bool isFaster) {
  return setTo(clock.runs, std::clamp(clock.rate * (isFaster ? 2 : 0.5), kSlowestClock, kFastestClock), 0);
}

wire::SetClock movedBy(const ClockBar& clock, std::int64_t microseconds) {
  const auto time = static_cast<std::int64_t>(clock.time) + microseconds;
  return movedTo(clock, static_cast<std::uint64_t>(std::max<std::int64_t>(time, 0)));
}

wire::SetClock movedTo(const ClockBar& clock, std::uint64_t microseconds) {
  return setTo(clock.runs, clock.rate, std::clamp<std::uint64_t>(microseconds, 1, clock.end == 0 ? wire::kMaxTime : clock.end));
}

}  // namespace ridgecast::core
