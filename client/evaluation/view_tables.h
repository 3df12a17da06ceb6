#pragma once
// Results of the cameras at rest (views.h) as tables.

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <vector>

#include "client/evaluation/table.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// The view.json of each folder. Error: one cannot be read.
Outcome<std::vector<nlohmann::json>> readViews(std::span<const std::filesystem::path> folders);
// Throws nlohmann::json::exception if another version wrote them.
std::vector<Table> viewTables(const std::vector<nlohmann::json>& views);

}  // namespace ridgecast::evaluation
