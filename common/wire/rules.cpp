#include "common/wire/rules.h"

#include <cmath>
#include <cstdio>

namespace ridgecast::wire {

std::string numberWords(double v) {
  int exponent = 0;
  if (v >= 1 << 20 && std::frexp(v, &exponent) == 0.5) return "2^" + std::to_string(exponent - 1);
  if (v >= 1e5 && std::pow(10, std::round(std::log10(v))) == v) return "1e" + std::to_string(std::lround(std::log10(v)));
  char digits[32];
  std::snprintf(digits, sizeof(digits), v == std::round(v) ? "%.0f" : "%g", v);
  std::string out = digits;
  if (v >= 1000)
    for (std::size_t at = out.size(); at > 3; at -= 3) out.insert(at - 3, ",");
  return out;
}

std::string bytesWords(std::size_t n) {
  for (const auto& [unit, bits] : {std::pair{" MiB", 20}, std::pair{" KiB", 10}})
    if (n >> bits && (n >> bits) << bits == n) return numberWords(static_cast<double>(n >> bits)) + unit;
  return numberWords(static_cast<double>(n)) + " bytes";
}

std::string OneOf::words() const {
  std::string out;
  for (const char* name : names) out += (out.empty() ? "" : ", ") + std::string(name);
  return out;
}

}  // namespace ridgecast::wire
