#pragma once
// Figures out of JSON, for tables in which what was not measured stays empty.

#include <nlohmann/json.hpp>

#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// kNothing where there is no number of that name.
inline double number(const nlohmann::json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_number() ? it->get<double>() : kNothing;
}

}  // namespace ridgecast::evaluation
