#pragma once
// What a token grants to who shows it.

#include <chrono>
#include <optional>
#include <string>

#include "server/access/rights.h"

namespace ridgecast::access {

using Time = std::chrono::sys_seconds;
// Later times count as this one: clocks of nanoseconds end in 2262.
inline constexpr Time kLatest = std::chrono::sys_days(std::chrono::year(2200) / 1 / 1);

struct Grant {
  std::string name;  // whose it is, for logs: at most 64 printable characters without blanks; may be empty
  Rights rights;
  std::string session;          // the one session it is for; empty: all
  std::optional<Time> expires;  // the first second at which it is none any more

  bool reaches(std::string_view wanted) const { return session.empty() || session == wanted; }
};

// 1 to 64 letters, digits and ._-@: fit for a file of tokens and a line of a log.
bool holderNameIsValid(std::string_view name);

}  // namespace ridgecast::access
