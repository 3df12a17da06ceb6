#include "client/viewer/coordinates.h"

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

namespace ridgecast::viewer {
namespace {

constexpr std::int64_t kPerMetre = std::int64_t{1} << lattice::kStepBits;
constexpr std::int64_t kMostMetres = lattice::kMaxPosition / kPerMetre;

}  // namespace

Outcome<lattice::Step> parseMetres(std::string_view text) {
  const Error wrong{"'" + std::string(text.substr(0, 40)) + "' is no place: give a number of metres from -" + std::to_string(kMostMetres) +
                    " to " + std::to_string(kMostMetres)};
  std::string digits;
  for (const char c : text)
    if (c != '_' && c != '\'' && c != ' ') digits += c;
  if (digits.size() > 40) return wrong;
  const bool negative = !digits.empty() && digits.front() == '-';
  if (!digits.empty() && (digits.front() == '-' || digits.front() == '+')) digits.erase(0, 1);
  const std::size_t point = digits.find('.');
  const std::string whole = digits.substr(0, point), rest = point == std::string::npos ? "" : digits.substr(point + 1);
  if ((whole + rest).empty() || (whole + rest).find_first_not_of("0123456789") != std::string::npos) return wrong;
  std::int64_t metres = 0;
  if (!whole.empty() && std::from_chars(whole.data(), whole.data() + whole.size(), metres).ec != std::errc()) return wrong;
  if (metres > kMostMetres) return wrong;
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
