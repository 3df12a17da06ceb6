#include "common/glsl/complaints.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "common/glsl/tokens.h"
#include "common/outcome/contract.h"

namespace ridgecast::glsl {
namespace {

constexpr std::size_t kMaxColumns = 200;  // of a line that is shown

// 0: the complaint names none.
std::size_t lineOf(std::string_view file, std::string_view complaint) {
  std::size_t line = 0;
  if (complaint.starts_with(file) && complaint.substr(file.size()).starts_with(":"))
    std::from_chars(complaint.data() + file.size() + 1, complaint.data() + complaint.size(), line);
  return line;
}

std::string_view lineAt(std::string_view text, std::size_t number) {
  for (; number > 1 && !text.empty(); --number) text::takePart(text, '\n');
  return text.substr(0, text.find('\n'));
}

bool isWord(std::string_view s, std::size_t at, std::size_t size) {
  return (at == 0 || !isNameCharacter(s[at - 1])) && (at + size >= s.size() || !isNameCharacter(s[at + size]));
}

// Where the word or mark stands in the line, the nth time.
std::optional<std::size_t> placeOf(std::string_view line, std::string_view what, std::size_t nth = 0) {
  if (what.empty()) return {};
  for (std::size_t at = line.find(what); at != std::string_view::npos; at = line.find(what, at + 1)) {
    if (isNameCharacter(what[0]) ? !isWord(line, at, what.size()) : false) continue;
    if (nth-- == 0) return at;
  }
  return {};
}

// The whole number that begins at or after `at`, after blanks and signs only; its digits.
std::string_view intAfter(std::string_view line, std::size_t at) {
  at = std::min(line.find_first_not_of(" \t-+", at), line.size());
  const std::size_t end = std::min(line.find_first_not_of("0123456789", at), line.size());
  const bool isWhole = end == line.size() || (line[end] != '.' && !isNameCharacter(line[end]));
  return isWhole ? line.substr(at, end - at) : std::string_view();
}
std::string_view intBefore(std::string_view line, std::size_t at) {
  const std::size_t last = at == 0 ? std::string_view::npos : line.find_last_not_of(" \t", at - 1);
  if (last == std::string_view::npos) return {};
  std::size_t begin = last + 1;
  while (begin > 0 && line[begin - 1] >= '0' && line[begin - 1] <= '9') --begin;
  const bool isWhole = begin == 0 || (line[begin - 1] != '.' && !isNameCharacter(line[begin - 1]));
  return isWhole ? line.substr(begin, last + 1 - begin) : std::string_view();
}

// What a picture's program has and a terrain has not.
std::string_view insteadOf(std::string_view name) {
  if (name == "iTime" || name == "iTimeDelta" || name == "iFrame" || name == "iDate" || name == "time")
    return "; the ground has no time: leave it out, or write a constant";
  if (name == "iResolution" || name == "iMouse" || name == "fragCoord" || name == "uv")
    return "; the ground has no picture: its place is in `cell`, a square of 4,096 m, at `fraction` of its sides";
  if (name.starts_with("iChannel") || name.starts_with("texture") || name == "texelFetch")
    return "; a terrain has no textures: write valueNoise(p.cell, p.at, mixedSeed(seed)).x with Place p = widestPlace(cell, fraction)";
  return "";
}

// An int beside an operator, after return or among a call's arguments: its digits, a part of the line.
std::string_view strayInt(std::string_view line, std::string_view token, std::string_view complaint, std::size_t nth) {
  const bool isCall = complaint.find("no matching overloaded function") != std::string_view::npos;
  if (!isCall && complaint.find("cannot convert from ' const int'") == std::string_view::npos &&
      complaint.find("type ' const int'") == std::string_view::npos && token != "return")
    return {};
  for (std::size_t k = 0; const auto at = placeOf(line, token, k); ++k) {
    const std::size_t after = *at + token.size();
    std::string_view found;
    if (isCall) {
      const std::size_t open = line.find('(', after), close = std::min(line.find(')', after), line.size());
      for (std::size_t i = open; found.empty() && i < close; i = line.find(',', i + 1)) found = intAfter(line, i + 1);
    } else {
      found = intAfter(line, after);
      if (found.empty()) found = intBefore(line, *at);
    }
    if (!found.empty() && nth-- == 0) return found;
  }
  return {};
}

// The first '...' of a complaint, the front end's name for the place.
std::string_view tokenOf(std::string_view complaint) {
  const std::size_t open = complaint.find('\''), close = complaint.find('\'', open + 1);
  return open == std::string_view::npos || close == std::string_view::npos ? "" : complaint.substr(open + 1, close - open - 1);
}

// The line as shown, and a caret below its byte `at`.
std::string excerpt(std::string_view line, std::size_t at) {
  std::string out = "\n  ", below = "\n  ";
  for (std::size_t i = 0; i < line.size(); ++i) {
    const auto c = static_cast<unsigned char>(line[i]);
    if ((c & 0xc0) == 0x80) continue;  // the rest of a character that is shown as ?
    out += c == '\t' ? '\t' : c < 0x20 ? ' ' : c < 0x80 ? line[i] : '?';
    if (i < at) below += c == '\t' ? '\t' : ' ';
  }
  return out + below + "^";
}

// Whether a line takes a power of what noise or a wave returns, or of -a, as it is: products alone keep the sign.
bool takesPowerOfNegative(std::string_view line) {
  for (std::size_t at = line.find("pow("); at != std::string_view::npos; at = line.find("pow(", at + 1)) {
    if (!isWord(line, at, 3)) continue;
    std::string_view base = trimmed(line.substr(at + 4));
    int depth = 0;
    std::size_t end = 0;
    bool isSum = false;
    for (; end < base.size() && (depth > 0 || base[end] != ','); ++end) {
      depth += base[end] == '(' ? 1 : base[end] == ')' ? -1 : 0;
      isSum |= end > 0 && depth == 0 && (base[end] == '+' || base[end] == '-');
    }
    base = base.substr(0, end);
    if (isSum) continue;
    if (base.starts_with('-')) return true;
    for (const std::string_view signs : {"valueNoise(", "gradientNoise(", "plainNoise(", "signedUnit(", "wave(", "sin(", "cos("})
      if (base.starts_with(signs)) return true;
  }
  return false;
}

}  // namespace

Error joined(std::string_view file, std::vector<std::string> complaints) {
  expects(!complaints.empty(), "an error says what is wrong");
  std::ranges::stable_sort(complaints, {}, [&](const std::string& c) { return lineOf(file, c); });
  std::set<std::string> seen;
  std::erase_if(complaints, [&](const std::string& c) { return !seen.insert(c).second; });
  std::string out;
  for (std::size_t k = 0; k < std::min(complaints.size(), kMaxComplaints); ++k) out.append(k ? "\n" : "").append(complaints[k]);
  if (complaints.size() > kMaxComplaints)
    out.append("\n").append(file).append(": and ").append(std::to_string(complaints.size() - kMaxComplaints)).append(" errors more");
  return Error{std::move(out)};
}

std::string explained(std::string_view file, std::string_view text, std::string_view message) {
  std::string out;
  std::map<std::pair<std::size_t, std::string_view>, std::size_t> seen;  // so many complaints about this token of this line
  while (!message.empty()) {
    const std::string_view complaint = text::takePart(message, '\n');
    out.append(out.empty() ? "" : "\n").append(complaint);
    const std::size_t number = lineOf(file, complaint);
    const std::string_view line = number ? lineAt(text, number) : std::string_view();
    if (trimmed(line).empty() || line.size() > kMaxColumns) continue;
    const std::string_view token = tokenOf(complaint);
    const std::size_t nth = seen[{number, token}]++;
    const std::string_view stray = strayInt(line, token, complaint, nth);
    const bool isUint = complaint.find("uint'") != complaint.npos;
    if (!stray.empty()) {
      out.append("; an int does not become a ").append(isUint ? "uint" : "float").append(" by itself: write ").append(stray);
      out.append(isUint ? "u" : ".0");
    }
    if (complaint.find("undeclared identifier") != complaint.npos || complaint.find("no matching overloaded") != complaint.npos)
      out.append(insteadOf(token));
    const auto place = stray.empty() ? placeOf(line, token, nth) : static_cast<std::size_t>(stray.data() - line.data());
    out += excerpt(line, place.value_or(placeOf(line, token).value_or(line.find_first_not_of(" \t"))));
  }
  return out;
}

std::string withoutComments(std::string_view text) {
  std::string out(text);
  for (std::size_t i = 0; i + 1 < out.size(); ++i) {
    if (out[i] != '/' || (out[i + 1] != '/' && out[i + 1] != '*')) continue;
    const bool toEndOfLine = out[i + 1] == '/';
    const std::size_t found = toEndOfLine ? out.find('\n', i) : out.find("*/", i + 2);
    const std::size_t end = found == std::string::npos ? out.size() : toEndOfLine ? found : found + 2;
    for (; i < end; ++i)
      if (out[i] != '\n') out[i] = ' ';
    --i;
  }
  return out;
}

std::string advice(std::string_view file, std::string_view text) {
  const std::string code = withoutComments(text);
  std::vector<std::string> complaints;
  std::size_t number = 0;
  for (std::string_view rest = code; !rest.empty();) {
    const std::string_view whole = text::takePart(rest, '\n');
    std::string line(whole);
    ++number;
    std::erase_if(line, [](char c) { return c == ' ' || c == '\t'; });
    // The usual hash's factor tells it where the sine has a line of its own.
    const bool isOne = line.find("fract(sin(") != std::string::npos;
    if (isOne || line.find("43758.5") != std::string::npos)
      complaints.push_back(at(file, number) + (isOne ? "'fract'(sin(...))" : "'43758.5'") +
                           " is noise that differs between machines and loses its bits far out; write valueNoise(p.cell, p.at, "
                           "mixedSeed(seed)).x, or hash the square's integers");
    if (line.find("vec2(cell)+fraction") != std::string::npos && line.find("4096.") != std::string::npos)
      complaints.push_back(at(file, number) +
                           "'cell' in metres is a float of 24 bits: the ground is bricks of 2 m from 20,000 km on, and one plain farther "
                           "out; write widestPlace(cell, fraction), whose p.cell and p.at noise takes");
    if (takesPowerOfNegative(whole))
      complaints.push_back(at(file, number) +
                           "'pow' is not a number where its base is negative, as this one may be; write pow(abs(a), b) or "
                           "pow(max(a, 0.0), b)");
  }
  return complaints.empty() ? "" : explained(file, text, joined(file, std::move(complaints)).message);
}

}  // namespace ridgecast::glsl
