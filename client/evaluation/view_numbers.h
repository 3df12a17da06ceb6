#pragma once
// Results from view.json (views.h), for tables and targets; kNothing if not measured.

#include <nlohmann/json.hpp>
#include <vector>

#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// kNothing where there is no number of that name.
inline double number(const nlohmann::json& json, const char* key) {
  const auto it = json.find(key);
  return it != json.end() && it->is_number() ? it->get<double>() : kNothing;
}

inline std::vector<double> numbers(const nlohmann::json& json, const char* key) { return json.value(key, std::vector<double>()); }

// All timings of the ray march, which is the same for every mesh of a view.
inline std::vector<double> marches(const nlohmann::json& view, const char* key) {
  std::vector<double> out;
  for (const nlohmann::json& mesh : view.at("meshes"))
    for (const double v : numbers(mesh.at("times"), key)) out.push_back(v);
  return out;
}

// The picture of a mesh with this many samples a pixel; null: none.
inline const nlohmann::json* pictureOf(const nlohmann::json& mesh, int samples, bool filtered) {
  for (const nlohmann::json& p : mesh.at("pictures"))
    if (p.at("samples") == samples && p.at("filtered") == filtered) return &p;
  return nullptr;
}

inline double ssim(const nlohmann::json* picture, const char* which, const char* where) {
  return picture ? number(picture->at(which), where) : kNothing;
}

}  // namespace ridgecast::evaluation
