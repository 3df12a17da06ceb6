#pragma once
// Where a setting comes from: its flag, else the environment (RIDGECAST_MAX_CAMERAS for --max-cameras), else the settings file, else its
// default. What is unknown in any of them is an error.

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "common/outcome/outcome.h"

namespace CLI {
class App;
}

namespace ridgecast::config {

// Of each setting by its long flag without hyphens: "flag", "environment RIDGECAST_PORT", "file FILE:3" or "default".
using Sources = std::map<std::string, std::string>;

// After app.parse(): gives the options that no flag set the values of environment and file, checked as flags are. Lists are written with
// commas in the environment. Options that are not configurable() are no settings. `file`: empty: none.
Outcome<Sources> addLayers(CLI::App& app, const std::filesystem::path& file, const char* const* environment);

// The settings as a settings file, each with its source behind it.
std::string describe(const CLI::App& app, const Sources& sources);

// RIDGECAST_ and the flag in capitals, hyphens as underscores.
std::string variableOf(const std::string& key);

}  // namespace ridgecast::config
