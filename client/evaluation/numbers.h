#pragma once
// Measured numbers.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <vector>

namespace ridgecast::evaluation {

inline constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();  // what was not measured

// The upper median; of none: kNothing.
inline double median(std::vector<double> values) {
  if (values.empty()) return kNothing;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

// printf with one number; nothing that is finite: empty.
inline std::string cell(const char* format, double value) {
  if (!std::isfinite(value)) return {};
  char out[64];
  std::snprintf(out, sizeof out, format, value);
  return out;
}

}  // namespace ridgecast::evaluation
