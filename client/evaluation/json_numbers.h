#pragma once
// Figures out of JSON, for tables in which what was not measured stays empty.

#include <limits>
#include <nlohmann/json.hpp>

namespace ridgecast::evaluation {

inline constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();

// kNothing where there is no number of that name.
inline double number(const nlohmann::json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_number() ? it->get<double>() : kNothing;
}

}  // namespace ridgecast::evaluation
