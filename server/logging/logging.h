#pragma once
// The log: lines on standard error, as text for people or as JSON, one object a line, for machines. Whatever a message holds, a line stays
// one line: control characters and bytes that are no UTF-8 are escaped or replaced.
//
//     12:30:01 info session=default camera=3 peer=192.0.2.1:5004 says hello as 'ridgecast-client'
//     {"time":"2026-11-21T12:30:01.123Z","level":"info","message":"says hello ...","session":"default","camera":3,"peer":"192.0.2.1:5004"}
//
// Any thread. Lines of one message are written at once.

#include <cstdint>
#include <string>
#include <string_view>

namespace ridgecast::logging {

enum class Level { kDebug, kInfo, kWarning, kError, kOff };
enum class Format { kText, kJson };

// What a line is about; empty and 0: not said. Views must live for the call.
struct About {
  std::string_view session{};
  std::uint64_t camera = 0;
  std::string_view peer{};
  std::string_view holder{};  // of the token
};

void setUp(Format format, Level level);
void write(Level level, const About& about, std::string_view message);

inline void debug(const About& about, std::string_view message) { write(Level::kDebug, about, message); }
inline void info(const About& about, std::string_view message) { write(Level::kInfo, about, message); }
inline void warning(const About& about, std::string_view message) { write(Level::kWarning, about, message); }
inline void error(const About& about, std::string_view message) { write(Level::kError, about, message); }
inline void info(std::string_view message) { write(Level::kInfo, {}, message); }
inline void warning(std::string_view message) { write(Level::kWarning, {}, message); }
inline void error(std::string_view message) { write(Level::kError, {}, message); }

// One line, without its end; `milliseconds` since 1970. What write() writes.
std::string line(Format format, Level level, const About& about, std::string_view message, std::int64_t milliseconds);

}  // namespace ridgecast::logging
