#include "client/viewer/clock_bar.h"

#include <algorithm>
#include <cstdio>

#include "common/wire/wire.h"

namespace ridgecast::viewer {

namespace {

wire::SetClock setTo(bool runs, double rate, std::uint64_t time) {
  using enum wire::ClockMode;
  return {true, !runs ? kStepped : rate == 1 ? kRealTime : kScaled, rate, time};
}

}  // namespace

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

}  // namespace ridgecast::viewer
