#include "tests/simulation/event.h"

#include <algorithm>
#include <iterator>
#include <sstream>
#include <string_view>

#include "common/wire/wire.h"

namespace ridgecast::simulation {
namespace {

constexpr std::string_view kNames[] = {"fly",     "lose", "leave", "mute",     "clock", "step",  "threshold", "ask",  "edit", "post",
                                       "stall",   "lie",  "wait",  "storm",    "stop",  "claim", "crash",     "cut",  "fill", "starve",
                                       "upgrade", "part", "halt",  "lose-end", "slow",  "full",  "jump",      "visit"};
static_assert(std::size(kNames) == static_cast<std::size_t>(Kind::kVisit) + 1);

Event chooseBreak(Random& random) {
  switch (random() % 20) {
    case 0:
      return {Kind::kCrash};
    case 1:
    case 7:
      return {Kind::kStop};
    case 2:
    case 3:
      return {Kind::kCut, 0, 1 + random() % 40};
    case 4:
      return {Kind::kFill, 0, 1 + random() % 40};
    case 6:
      return {Kind::kClaim, random() % 2, random() % 1000};
    case 5:
      return {Kind::kStarve, 0, random() % 3000};
    default:
      return {Kind::kStorm, 0, random() % 60 == 0 ? wire::kMaxEdits : random() % 3};
  }
}

Event chooseBetweenServers(Random& random) {
  const std::uint64_t who = random() % 60;
  switch (random() % 16) {
    case 0:
      return {Kind::kCrash, who};
    case 1:
      return {Kind::kStop, who};
    case 2:
      return {Kind::kUpgrade};
    case 3:
    case 4:
      return {Kind::kPart, who, random() % 6000};
    case 5:
      return {Kind::kHalt, 0, random() % 5000};
    case 6:
    case 7:
      return {Kind::kLoseEnd, who, random() % 8};
    case 8:
    case 9:
      return {Kind::kSlow, 0, random() % 30};
    case 10:
      return {Kind::kFull, 0, random() % 2000};
    case 11:
      return {Kind::kJump, 0, random() % 20'000};
    case 12:
      return random() % 4 == 0 ? Event{Kind::kCut, 0, 1 + random() % 40} : Event{Kind::kFill, 0, 1 + random() % 40};
    default:
      return {Kind::kVisit, who, random() % 2};
  }
}

Event choose(Random& random, bool withLiar) {
  if (withLiar && random() % 4 == 0) return {Kind::kLie};
  const std::uint64_t who = random() % 60;  // of 2 to 5
  switch (random() % 47) {
    case 0:
      return {Kind::kLose, who, random() % 40'000};
    case 1:
      return {Kind::kLeave, who, random() % 40'000};
    case 2:
      return random() % 2 == 0 ? Event{Kind::kClock, who} : Event{Kind::kMute, who, random() % 20'000};
    case 3:
      return {Kind::kThreshold, who, 10 + random() % 40};
    case 4:
    case 5:
    case 6:
      return {Kind::kAsk, who};
    case 7:
    case 8:
      return {Kind::kStep, who};
    case 9:
      return {Kind::kWait, 0, random() % 3000};
    case 10:
    case 11:
    case 12:
      return {Kind::kEdit, who};
    case 13:
      return chooseBreak(random);
    case 14:
    case 15:
      return {Kind::kPost, who};
    case 16:
      return {Kind::kStall, who, random() % 5000};
    default:
      return {Kind::kFly, who, random() % 20};
  }
}

}  // namespace

Events eventsOf(std::uint64_t seed, bool withLiar, bool withServers, Duration time) {
  Random random(~seed);
  Events out;
  bool isUpgraded = !withServers;  // at least once
  for (Duration sum{}; sum < time;) {
    Event event = withServers && random() % 12 == 0 ? chooseBetweenServers(random) : choose(random, withLiar);
    if (!isUpgraded && sum > time / 4) {
      isUpgraded = true;
      event = {Kind::kUpgrade};
    }
    event.pause = random() % 120'000;
    event.dice = random() >> 32;
    sum += std::chrono::microseconds(event.pause) + std::chrono::milliseconds(event.kind == Kind::kWait ? event.amount : 0);
    out.push_back(event);
  }
  return out;
}

std::string toText(const Events& events) {
  std::ostringstream out;
  for (const Event& e : events)
    out << kNames[static_cast<std::size_t>(e.kind)] << ' ' << e.who << ' ' << e.amount << ' ' << e.pause << ' ' << e.dice << '\n';
  return out.str();
}

std::optional<Events> eventsFrom(const std::string& text) {
  Events out;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::string name;
    Event event;
    words >> name >> event.who >> event.amount >> event.pause >> event.dice;
    const auto* const kind = std::ranges::find(kNames, name);
    if (words.fail() || kind == std::end(kNames)) return {};
    event.kind = static_cast<Kind>(kind - std::begin(kNames));
    out.push_back(event);
  }
  return out;
}

}  // namespace ridgecast::simulation
