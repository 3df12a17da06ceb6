#include "server/logging/logging.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <functional>
#include <limits>
#include <mutex>
#include <nlohmann/json.hpp>
#include <utility>

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

using Json = nlohmann::ordered_json;

// As JSON on one line: DEL, C1 and Unicode's line separators, which JSON lets through, are escaped too; what is no UTF-8 becomes U+FFFD.
std::string dumped(const Json& value) {
  const std::string text = value.dump(-1, ' ', false, Json::error_handler_t::replace);
  std::string out;
  for (std::string_view rest = text; !rest.empty();) {
    const auto byte = [&](std::size_t k) { return k < rest.size() ? static_cast<unsigned char>(rest[k]) : 0u; };
    const bool c1 = byte(0) == 0xc2 && byte(1) < 0xa0, separator = rest.starts_with("\xe2\x80\xa8") || rest.starts_with("\xe2\x80\xa9");
    if (byte(0) == 0x7f || c1 || separator) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", separator ? 0x2000 + (byte(2) & 0x3f) : byte(c1));
      out += escape;
    } else {
      out += rest.front();
    }
    rest.remove_prefix(separator ? 3 : c1 ? 2 : 1);
  }
  return out;
}

// The same for people: no quotation marks around it, and those within, and backslashes, as they are.
std::string plain(const Json& value) {
  std::string text = dumped(value);
  if (!value.is_string()) return text;
  std::string out;
  for (std::size_t k = 1; k + 1 < text.size(); ++k) {
    if (text[k] == '\\' && (text[k + 1] == '"' || text[k + 1] == '\\')) ++k;
    out += text[k];
  }
  return out;
}

// ADDRESS of ADDRESS:PORT and [ADDRESS]:PORT; an address alone, as behind a proxy, stays.
std::string_view withoutPort(std::string_view peer) {
  const auto colon = peer.rfind(':');
  const bool hasPort = colon != peer.npos && (peer.find(':') == colon || peer.find("]:") != peer.npos);
  return hasPort ? peer.substr(0, colon) : peer;
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
  Json fields = Json::object();
  if (!about.session.empty()) fields["session"] = about.session;
  if (about.camera != 0) fields["camera"] = about.camera;
  if (!about.peer.empty()) fields["peer"] = about.peer;
  if (!about.holder.empty()) fields["holder"] = about.holder;
  if (about.repeated != 0) fields["repeated"] = about.repeated;
  if (form == Format::kJson) {
    if (!about.event.empty()) fields["event"] = about.event;
    if (!about.reason.empty()) fields["reason"] = about.reason;
    if (!about.path.empty()) fields["path"] = about.path;
    if (about.status != 0) fields["status"] = about.status;
    if (about.stay) fields.update({{"seconds", about.stay->seconds}, {"bytes", about.stay->bytes}, {"iterations", about.stay->iterations}});
    char fraction[8];
    std::snprintf(fraction, sizeof fraction, ".%03dZ", static_cast<int>(milliseconds % 1000));
    Json all{{"time", timeText(milliseconds, "%Y-%m-%dT%H:%M:%S") + fraction}, {"level", nameOf(level)}, {"message", message}};
    all.update(fields);
    return dumped(all);
  }
  std::string out = timeText(milliseconds, "%H:%M:%S ") + nameOf(level);
  for (const auto& [key, value] : fields.items()) out += " " + key + "=" + plain(value);
  return out + " " + plain(message);
}

bool Repeats::take(const About& about, std::string_view message, std::int64_t milliseconds) {
  std::array<std::string, 3> key{std::string(about.event), std::string(about.reason), std::string(withoutPort(about.peer))};
  if (kinds_.size() >= kMaxKinds && !kinds_.contains(key)) key[2].clear();
  const auto [found, isNew] = kinds_.try_emplace(std::move(key), Kind{milliseconds});
  if (isNew) next_ = std::min(next_, milliseconds + kEvery);
  Kind& kind = found->second;
  const bool isRefusal = about.event == "refused";
  const std::hash<std::string_view> hash;
  const std::size_t line = isRefusal ? hash(about.session) * 31 + hash(message) : kind.written.size();
  if (kind.written.size() < (isRefusal ? kMaxRefused : kMaxOthers) && kind.written.insert(line).second) return true;
  ++kind.leftOut;
  return false;
}

std::vector<Repeats::LeftOut> Repeats::leftOut(std::int64_t milliseconds, bool all) {
  std::vector<LeftOut> said;
  if (milliseconds < next_ && !all) return said;
  next_ = std::numeric_limits<std::int64_t>::max();
  std::erase_if(kinds_, [&](const auto& entry) {
    const auto& [key, kind] = entry;
    const std::int64_t end = kind.since + kEvery;
    if (milliseconds < end && !all) return next_ = std::min(next_, end), false;
    if (kind.leftOut > 0) said.push_back({key[0], key[1], key[2], kind.leftOut});
    return true;
  });
  return said;
}

namespace {

struct {
  std::mutex mutex;
  Repeats repeats;
} shared;

template <class Clock>
std::int64_t millisecondsOf() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now().time_since_epoch()).count();
}

void put(Level level, const About& about, std::string_view message) {
  std::string text = line(format, level, about, message, millisecondsOf<std::chrono::system_clock>());
  text += '\n';
  // One call, so that lines of several threads do not mix. What cannot be written is lost: there is nowhere to say so.
  for (std::string_view rest = text; !rest.empty();) {
    const ssize_t written = ::write(STDERR_FILENO, rest.data(), rest.size());
    if (written <= 0) break;
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace

void setUp(Format form, Level level) {
  format = form;
  least = level;
}

void write(Level level, const About& about, std::string_view message) {
  if (level < least) return;
  sayLeftOut();
  if (!about.reason.empty() || about.event == "hello") {
    const std::lock_guard lock(shared.mutex);
    if (!shared.repeats.take(about, message, millisecondsOf<std::chrono::steady_clock>())) return;
  }
  put(level, about, message);
}

void sayLeftOut(bool all) {
  if (Level::kInfo < least) return;
  std::vector<Repeats::LeftOut> leftOut;
  {
    const std::lock_guard lock(shared.mutex);
    leftOut = shared.repeats.leftOut(millisecondsOf<std::chrono::steady_clock>(), all);
  }
  for (const auto& [event, reason, client, lines] : leftOut)
    put(Level::kInfo, {.peer = client, .event = event, .reason = reason, .repeated = lines},
        "more such lines came within a minute and were left out (" + event + (reason.empty() ? "" : ", " + reason) + ")");
}

}  // namespace ridgecast::logging
