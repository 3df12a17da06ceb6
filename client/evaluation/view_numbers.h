#pragma once
// Results out of view.json (views.h), for tables and targets: what was not measured is kNothing.

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// kNothing where there is no number of that name.
inline double number(const nlohmann::json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_number() ? it->get<double>() : kNothing;
}

// Sorted.
inline std::vector<double> numbers(const nlohmann::json& json, const char* key) {
  if (!json.contains(key)) return {};
  std::vector<double> out = json.at(key).get<std::vector<double>>();
  std::ranges::sort(out);
  return out;
}

// Of the ray march, which is the same for every mesh of a view: all that were timed.
inline std::vector<double> marches(const nlohmann::json& view, const char* key) {
  std::vector<double> out;
  for (const nlohmann::json& mesh : view.at("meshes"))
    for (const double v : numbers(mesh.at("times"), key)) out.push_back(v);
  std::ranges::sort(out);
  return out;
}

inline double median(const std::vector<double>& sorted) { return sorted.empty() ? kNothing : sorted[sorted.size() / 2]; }
// The pictures of one mesh with so many samples; null: none.
inline const nlohmann::json* pictureOf(const nlohmann::json& mesh, int samples, bool filtered) {
  for (const nlohmann::json& p : mesh.at("pictures"))
    if (p.at("samples") == samples && p.at("filtered") == filtered) return &p;
  return nullptr;
}

inline double ssim(const nlohmann::json* picture, const char* which, const char* where) {
  return picture ? number(picture->at(which), where) : kNothing;
}

}  // namespace ridgecast::evaluation
