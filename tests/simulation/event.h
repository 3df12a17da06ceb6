#pragma once
// What happens in a simulation, as values: a run is a list of them from a seed. Each brings its own dice for what it does not say, so that
// it does the same without those before it.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tests/simulation/server.h"

namespace ridgecast::simulation {

enum class Kind {
  kFly,        // metres; who is away joins
  kLose,       // the line, until it is back; the server hears of it after so many milliseconds
  kLeave,      // as kLose, for good
  kMute,       // the line is dead, and its member notices after so many milliseconds
  kClock,      // is taken
  kStep,       // the clock
  kThreshold,  // pixels
  kAsk,        // for heights
  kEdit,
  kPost,    // an edit over HTTP
  kStall,   // it reads nothing for so many milliseconds
  kLie,     // the liar
  kWait,    // milliseconds, in which nobody does anything
  kStorm,   // the server's thread has other things to do, while everybody edits so often
  kStop,    // the server, with power
  kClaim,   // the other server wants a session for so many milliseconds
  kCrash,   // without
  kCut,     // the power, after so many operations of the disk
  kFill,    // the disk, after so many writes
  kStarve,  // the server has too little memory for so many milliseconds
  // Of several servers; kStop and kCrash are of one of them, kCut of all.
  kUpgrade,  // each is drained, ends and starts again, one after the other
  kPart,     // from the engine, for so many milliseconds
  kHalt,     // the engine, for so many milliseconds
  kLoseEnd,  // another engine takes over without the last so many entries, if all others are well
  kSlow,     // the engine, so many milliseconds each way
  kFull,     // the engine, for so many milliseconds
  kJump,     // the engine's clock, to so many milliseconds after 10 s before what it would be
  kVisit,    // somebody asks for a session, of one of two worlds
};

struct Event {
  Kind kind = Kind::kFly;
  std::uint64_t who = 0;     // of the members, modulo their number
  std::uint64_t amount = 0;  // see Kind
  std::uint64_t pause = 0;   // microseconds, afterwards
  std::uint64_t dice = 0;
};
using Events = std::vector<Event>;

// What this seed chooses, for about so long.
Events eventsOf(std::uint64_t seed, bool withLiar, bool withServers, Duration time);

// One a line: kind, who, amount, pause, dice. Empty lines and those that begin with # are skipped. Nothing: a line is something else.
std::string toText(const Events& events);
std::optional<Events> eventsFrom(const std::string& text);

}  // namespace ridgecast::simulation
