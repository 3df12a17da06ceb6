#pragma once
// What the standing cameras gave (views.h), as tables.

#include <filesystem>
#include <span>
#include <vector>

#include "client/evaluation/table.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// `folders` hold a view.json each. Error: one that cannot be read.
Outcome<std::vector<Table>> viewTables(std::span<const std::filesystem::path> folders);

}  // namespace ridgecast::evaluation
