#pragma once
// The log: lines on standard error, as text for people or as JSON, one object a line, for machines. Whatever a message holds, a line stays
// one line: control characters and bytes that are no UTF-8 are escaped or replaced.
//
//     12:30:01 info session=default camera=3 peer=192.0.2.1:5004 says hello as 'ridgecast-client'
//     {"time":"2026-11-21T12:30:01.123Z","level":"info","message":"says hello ...","session":"default","camera":3,"peer":"192.0.2.1:5004"}
//
// A JSON line also has the fields that only machines want, such as "event" and "reason".
//
// Lines that clients can cause at will, those with a reason and those of event "hello", are merged by client address, event and reason:
// of each, a minute has the first kMaxRefused different refusals, or the first kMaxOthers others. When it is over, one line says how many
// were left out ("repeated"): before the next line that is written, or by sayLeftOut().
//
// Any thread. Lines of one message are written at once.

#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace ridgecast::logging {

enum class Level { kDebug, kInfo, kWarning, kError, kOff };
enum class Format { kText, kJson };

// What a line is about; empty and 0: not said. Views must live for the call.
struct About {
  std::string_view session{};
  std::uint64_t camera = 0;
  std::string_view peer{};
  std::string_view holder{};  // of the token
  // For machines.
  std::string_view event{};   // as server/README.md lists them
  std::string_view reason{};  // of a refusal or an end: the label of ridgecast_refusals_total, or left
  std::string_view path{};    // of an HTTP request
  unsigned status = 0;        // of its answer
  struct Stay {
    double seconds = 0;
    std::uint64_t bytes = 0, iterations = 0;  // sent
  };
  std::optional<Stay> stay{};  // of a stream that ended
  std::uint64_t repeated = 0;  // such lines that were left out
};

void setUp(Format format, Level level);
// Says how many lines were left out in minutes that are over; `all`: in the others, too, as the process ends.
void sayLeftOut(bool all = false);
void write(Level level, const About& about, std::string_view message);

inline void debug(const About& about, std::string_view message) { write(Level::kDebug, about, message); }
inline void info(const About& about, std::string_view message) { write(Level::kInfo, about, message); }
inline void warning(const About& about, std::string_view message) { write(Level::kWarning, about, message); }
inline void error(const About& about, std::string_view message) { write(Level::kError, about, message); }
inline void info(std::string_view message) { write(Level::kInfo, {}, message); }
inline void warning(std::string_view message) { write(Level::kWarning, {}, message); }
inline void error(std::string_view message) { write(Level::kError, {}, message); }

// Which lines to leave out. At most kMaxKinds clients, events and reasons are told apart; beyond that, clients are merged. Not thread-safe.
class Repeats {
 public:
  static constexpr std::int64_t kEvery = 60'000;  // milliseconds
  static constexpr std::size_t kMaxKinds = 256;
  static constexpr std::size_t kMaxRefused = 8, kMaxOthers = 100;

  // Whether to write this line. `milliseconds` never go back.
  bool take(const About& about, std::string_view message, std::int64_t milliseconds);
  struct LeftOut {
    std::string event, reason, client;  // no client: of several
    std::uint64_t lines = 0;
  };
  // What was left out in minutes that are over; `all`: in the others, too.
  std::vector<LeftOut> leftOut(std::int64_t milliseconds, bool all = false);

 private:
  struct Kind {
    std::int64_t since = 0;
    std::set<std::size_t> written{};  // refusals: hashes of session and message
    std::uint64_t leftOut = 0;
  };
  std::map<std::array<std::string, 3>, Kind> kinds_;              // by event, reason, client
  std::int64_t next_ = std::numeric_limits<std::int64_t>::max();  // when a minute is over, at the earliest
};

// One line, without its end; `milliseconds` since 1970. What write() writes.
std::string line(Format format, Level level, const About& about, std::string_view message, std::int64_t milliseconds);

}  // namespace ridgecast::logging
