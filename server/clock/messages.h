#pragma once
// What servers keep and tell each other of a session's clock, as bytes: kFormat, then fields in the order of the structs
// (common/codec/fields.h), sets as their size and differences.

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/clock/calls.h"
#include "server/clock/clock.h"

namespace ridgecast::clock {

inline constexpr std::uint8_t kFormat = 1;

// The whole of a clock over several servers.
struct Record {
  struct Server {
    std::uint64_t applied = 0;          // its calls up to this number; each once
    bool isHere = false;                // false: it was not heard for long; its next calls begin with all its members
    std::set<std::uint64_t> members{};  // that follow the clock or have set it
  };
  std::uint64_t version = 0;      // goes up with each record
  std::uint64_t changes = 0;      // goes up with those that followers are notified of
  Clock clock{Clock::Instant()};  // its instants are the engine's
  std::map<std::uint32_t, Server> servers{};
};

// From the leader.
struct Told {
  std::uint64_t epoch = 0;
  bool isLast = false;  // it leads no longer
  Record record{};
  std::vector<Notice> notices{};
};

// To the leader.
struct ToldCalls {
  struct Member {
    std::uint64_t member = 0;
    bool follows = false;
  };
  struct Numbered {
    std::uint64_t number = 0;
    std::optional<std::vector<Member>> all{};  // instead of a call: the server's members are these; may follow any number
    Call call{};
  };
  std::uint32_t server = 0;
  bool isLast = false;  // it has no members any more
  std::vector<Numbered> calls{};
};

std::string toBytes(const Record& record);
std::string toBytes(const Told& told);
std::string toBytes(const ToldCalls& calls);
// Error: not of this format; one sentence. Memory is in proportion to the bytes.
Outcome<Record> recordOf(const std::string& bytes);
Outcome<Told> toldOf(const std::string& bytes);
Outcome<ToldCalls> toldCallsOf(const std::string& bytes);

}  // namespace ridgecast::clock
