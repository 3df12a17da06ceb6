#pragma once
// What a client may do. The names are those in token files and in a JWT's claim "rights".

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::access {

enum class Right : std::uint8_t {
  kView = 1,      // see sessions: streams, the list of sessions, figures
  kCreate = 2,    // create sessions
  kQuery = 4,     // ask for heights, normals and rays
  kSnapshot = 8,  // take glTF snapshots
  kClock = 16,    // take, set and step a session's clock
  kAdmin = 32,    // end sessions and send members away
  kEdit = 64,     // change a session's ground
};

std::string_view name(Right right);

class Rights {
 public:
  constexpr Rights() = default;
  constexpr Rights(Right right) : bits_(static_cast<std::uint8_t>(right)) {}
  static constexpr Rights all() {
    return Rights(Right::kView) | Right::kCreate | Right::kQuery | Right::kSnapshot | Right::kClock | Right::kAdmin | Right::kEdit;
  }
  constexpr bool has(Right right) const { return (bits_ & static_cast<std::uint8_t>(right)) != 0; }
  constexpr bool empty() const { return bits_ == 0; }
  constexpr Rights operator|(Rights other) const {
    Rights both;
    both.bits_ = static_cast<std::uint8_t>(bits_ | other.bits_);
    return both;
  }
  constexpr bool operator==(const Rights&) const = default;

 private:
  std::uint8_t bits_ = 0;
};

// "view,query" -> rights. Error: no right is named, or an unknown one.
Outcome<Rights> parseRights(std::string_view text);
std::string toText(Rights rights);  // "view,query"

// What a token grants its bearer.
using Time = std::chrono::sys_seconds;
// Later times count as this one: clocks of nanoseconds end in 2262.
inline constexpr Time kLatest = std::chrono::sys_days(std::chrono::year(2200) / 1 / 1);

struct Grant {
  std::string name;  // whose it is, for logs: at most 64 printable characters without blanks; may be empty
  Rights rights;
  std::string session;          // the one session it is for; empty: all
  std::optional<Time> expires;  // the first second at which it is no longer valid

  bool reaches(std::string_view wanted) const { return session.empty() || session == wanted; }
};

// 1 to 64 letters, digits and ._-@: fit for a file of tokens and a line of a log.
bool holderNameIsValid(std::string_view name);

}  // namespace ridgecast::access
