#include "server/logging/logging.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>

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

// Bytes of the UTF-8 character that `text` begins with; 0: none (RFC 3629: no overlong forms, no surrogates, nothing beyond U+10FFFF).
std::size_t characterBytes(std::string_view text) {
  const auto byte = [&](std::size_t k) { return k < text.size() ? static_cast<unsigned char>(text[k]) : 0u; };
  const auto follows = [&](std::size_t k, unsigned least_ = 0x80, unsigned most = 0xbf) { return byte(k) >= least_ && byte(k) <= most; };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  if (first >= 0xc2 && first <= 0xdf) return follows(1) ? 2 : 0;
  if (first >= 0xe0 && first <= 0xef) return follows(1, first == 0xe0 ? 0xa0 : 0x80, first == 0xed ? 0x9f : 0xbf) && follows(2) ? 3 : 0;
  if (first >= 0xf0 && first <= 0xf4)
    return follows(1, first == 0xf0 ? 0x90 : 0x80, first == 0xf4 ? 0x8f : 0xbf) && follows(2) && follows(3) ? 4 : 0;
  return 0;
}

// Control characters (C1 and the line separators of Unicode too) as \u00XX, quotation marks and backslashes behind a backslash where JSON
// wants it, bytes that are no UTF-8 as U+FFFD.
void append(std::string& out, std::string_view text, bool json) {
  while (!text.empty()) {
    const std::size_t bytes = characterBytes(text);
    const auto c = static_cast<unsigned char>(text.front());
    if (bytes == 0) {
      out += "\xef\xbf\xbd";
      text.remove_prefix(1);
      continue;
    }
    const bool c1 = bytes == 2 && c == 0xc2 && static_cast<unsigned char>(text[1]) < 0xa0;
    const bool separator = bytes == 3 && text.substr(0, 2) == "\xe2\x80" && (text[2] == '\xa8' || text[2] == '\xa9');
    if ((bytes == 1 && (c < 0x20 || c == 0x7f)) || c1 || separator) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x",
                    separator ? 0x2000u + (static_cast<unsigned char>(text[2]) & 0x3fu)
                    : c1      ? static_cast<unsigned char>(text[1])
                              : c);
      out += escape;
    } else {
      if (json && (c == '"' || c == '\\')) out += '\\';
      out += text.substr(0, bytes);
    }
    text.remove_prefix(bytes);
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
