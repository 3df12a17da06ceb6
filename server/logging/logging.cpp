#include "server/logging/logging.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>

namespace ridgecast::logging {

namespace {

std::atomic<Format> format{Format::kText};
std::atomic<Level> least{Level::kInfo};

const char* nameOf(Level level) {
  switch (level) {
    case Level::kDebug:
      return "debug";
    case Level::kInfo:
      return "info";
    case Level::kWarning:
      return "warning";
    default:
      return "error";
  }
}

// As JSON has it, and so with DEL, C1 and Unicode's line separators, which JSON lets through; what is no UTF-8 becomes U+FFFD. Quotation
// marks and backslashes stay as they are where no JSON is wanted.
void append(std::string& out, std::string_view text, bool json) {
  const std::string escaped = nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  for (std::string_view rest(escaped.data() + 1, escaped.size() - 2); !rest.empty();) {
    const auto byte = [&](std::size_t k) { return k < rest.size() ? static_cast<unsigned char>(rest[k]) : 0u; };
    const bool c1 = byte(0) == 0xc2 && byte(1) < 0xa0, separator = rest.starts_with("\xe2\x80\xa8") || rest.starts_with("\xe2\x80\xa9");
    if (byte(0) == 0x7f || c1 || separator) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", separator ? 0x2000 + (byte(2) & 0x3f) : byte(c1));
      out += escape;
    } else {
      if (!json && (rest.starts_with("\\\"") || rest.starts_with("\\\\"))) rest.remove_prefix(1);
      out += rest.front();
    }
    rest.remove_prefix(separator ? 3 : c1 ? 2 : 1);
  }
}

void field(std::string& out, bool json, std::string_view key, std::string_view value) {
  out += json ? ",\"" : " ";
  out += key;
  out += json ? "\":\"" : "=";
  append(out, value, json);
  if (json) out += '"';
}

std::string timeText(std::int64_t milliseconds, const char* pattern) {
  const std::time_t seconds = milliseconds / 1000;
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[40];
  return {text, std::strftime(text, sizeof text, pattern, &parts)};
}

}  // namespace

std::string line(Format form, Level level, const About& about, std::string_view message, std::int64_t milliseconds) {
  const bool json = form == Format::kJson;
  std::string out;
  if (json) {
    char fraction[8];
    std::snprintf(fraction, sizeof fraction, ".%03dZ", static_cast<int>(milliseconds % 1000));
    out = "{\"time\":\"" + timeText(milliseconds, "%Y-%m-%dT%H:%M:%S") + fraction + "\",\"level\":\"" + nameOf(level) + "\",\"message\":\"";
    append(out, message, true);
    out += '"';
  } else {
    out = timeText(milliseconds, "%H:%M:%S ") + nameOf(level);
  }
  if (!about.session.empty()) field(out, json, "session", about.session);
  if (about.camera != 0) {
    out += json ? ",\"camera\":" : " camera=";
    out += std::to_string(about.camera);
  }
  if (!about.peer.empty()) field(out, json, "peer", about.peer);
  if (!about.holder.empty()) field(out, json, "holder", about.holder);
  if (json) {
    out += '}';
  } else {
    out += ' ';
    append(out, message, false);
  }
  return out;
}

void setUp(Format form, Level level) {
  format = form;
  least = level;
}

void write(Level level, const About& about, std::string_view message) {
  if (level < least) return;
  const auto now = std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  std::string text = line(format, level, about, message, now);
  text += '\n';
  // One call, so that lines of several threads do not mix. What cannot be written is lost: there is nowhere to say so.
  for (std::string_view rest = text; !rest.empty();) {
    const ssize_t written = ::write(STDERR_FILENO, rest.data(), rest.size());
    if (written <= 0) break;
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace ridgecast::logging
