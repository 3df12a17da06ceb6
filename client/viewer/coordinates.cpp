#include "client/viewer/coordinates.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

namespace ridgecast::viewer {
namespace {

constexpr std::int64_t kPerMetre = std::int64_t{1} << lattice::kStepBits;
constexpr std::int64_t kMaxMetres = lattice::kMaxPosition / kPerMetre;

// "1.5e3" -> "1500."; others stay as they are.
std::string withoutExponent(const std::string& text) {
  const std::size_t e = text.find_first_of("eE");
  if (e == std::string::npos) return text;
  int shift = 0;
  const auto [end, problem] = std::from_chars(text.data() + e + 1 + (text[e + 1] == '+'), text.data() + text.size(), shift);
  if (problem != std::errc() || end != text.data() + text.size() || std::abs(shift) > 40) return text;
  std::string digits = text.substr(0, e);
  std::size_t point = digits.find('.');
  if (point != std::string::npos) digits.erase(point, 1);
  if (digits.empty()) return text;
  point = std::min(point, digits.size());
  if (shift < 0)
    digits.insert(0, static_cast<std::size_t>(-shift), '0');
  else
    digits.append(static_cast<std::size_t>(shift), '0'), point += static_cast<std::size_t>(shift);
  return digits.insert(point, 1, '.');
}

}  // namespace

Outcome<lattice::Step> parseMetres(std::string_view text) {
  const Error wrong{"'" + std::string(text.substr(0, 40)) + "' is not a place: give a number of metres from -" +
                    std::to_string(kMaxMetres) + " to " + std::to_string(kMaxMetres)};
  std::string digits;
  for (const char c : text)
    if (c != '_' && c != '\'' && c != ' ') digits += c;
  if (digits.size() > 40) return wrong;
  const bool negative = !digits.empty() && digits.front() == '-';
  if (!digits.empty() && (digits.front() == '-' || digits.front() == '+')) digits.erase(0, 1);
  digits = withoutExponent(digits);
  const std::size_t point = digits.find('.');
  const std::string whole = digits.substr(0, point), rest = point == std::string::npos ? "" : digits.substr(point + 1);
  if ((whole + rest).empty() || (whole + rest).find_first_not_of("0123456789") != std::string::npos) return wrong;
  std::int64_t metres = 0;
  if (!whole.empty() && std::from_chars(whole.data(), whole.data() + whole.size(), metres).ec != std::errc()) return wrong;
  if (metres > kMaxMetres) return wrong;
  const double fraction = rest.empty() ? 0 : std::strtod(("0." + rest).c_str(), nullptr);
  const lattice::Step steps = metres * kPerMetre + std::llround(fraction * static_cast<double>(kPerMetre));
  if (steps > lattice::kMaxPosition) return wrong;
  return negative ? -steps : steps;
}

std::string formatMetres(lattice::Step steps) {
  const std::int64_t metres = std::abs(steps) / kPerMetre, rest = std::abs(steps) % kPerMetre;
  std::string out = (steps < 0 ? "-" : "") + std::to_string(metres);
  if (rest != 0) {
    char text[16];
    std::snprintf(text, sizeof text, "%.3f", static_cast<double>(rest) / static_cast<double>(kPerMetre));
    out += text + 1;  // without the 0; 255/256 is .996
  }
  return out;
}

}  // namespace ridgecast::viewer
