#include "server/logging/logging.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
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

std::optional<std::uint64_t> Repeats::take(const About& about, std::string_view message, std::int64_t milliseconds) {
  const auto isOver = [&](const auto& kind) { return milliseconds - kind.second.written >= kEvery; };
  std::string key;
  for (const std::string_view part : {about.reason, about.session, about.peer.substr(0, about.peer.rfind(':')), message})
    key.append(part).push_back('\0');
  if (!kinds_.contains(key) && kinds_.size() >= kMaxKinds) {
    std::erase_if(kinds_, isOver);
    if (kinds_.size() >= kMaxKinds) key.clear();  // whatever else
  }
  const auto [kind, isNew] = kinds_.try_emplace(std::move(key));
  if (!isNew && !isOver(*kind)) {
    ++kind->second.more;
    return std::nullopt;
  }
  kind->second.written = milliseconds;
  return std::exchange(kind->second.more, 0);
}

void setUp(Format form, Level level) {
  format = form;
  least = level;
}

void write(Level level, const About& about, std::string_view message) {
  if (level < least) return;
  const auto now = std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  About said = about;
  if (!about.reason.empty() && !about.stay) {
    static std::mutex mutex;
    static Repeats repeats;
    const std::lock_guard lock(mutex);
    const auto more = repeats.take(about, message, now);
    if (!more) return;
    said.repeated = *more;
  }
  std::string text = line(format, level, said, message, now);
  text += '\n';
  // One call, so that lines of several threads do not mix. What cannot be written is lost: there is nowhere to say so.
  for (std::string_view rest = text; !rest.empty();) {
    const ssize_t written = ::write(STDERR_FILENO, rest.data(), rest.size());
    if (written <= 0) break;
    rest.remove_prefix(static_cast<std::size_t>(written));
  }
}

}  // namespace ridgecast::logging
