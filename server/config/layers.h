#pragma once
// The source of a setting. Precedence, highest first: flag, environment (RIDGECAST_MAX_CAMERAS for --max-cameras), settings file, default.
// An unknown name in any of them is an error, except for the variables that Kubernetes sets for Services named ridgecast or ridgecast-...

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace CLI {
class App;
}

namespace ridgecast::config {

struct Layers {
  // The source of each setting, by its long flag without hyphens: "flag", "environment RIDGECAST_PORT", "file FILE:3" or "default".
  std::map<std::string, std::string> sources;
  std::vector<std::string> ignored;  // variables that Kubernetes sets for Services
};

// Call after app.parse(): gives options without a flag their values from environment and file, with the flags' checks. Lists are separated
// by commas in the environment. Options that are not configurable() are not settings. `file`: empty: none.
Outcome<Layers> addLayers(CLI::App& app, const std::filesystem::path& file, const char* const* environment);

// The settings as a settings file, each with its source in a comment.
std::string describe(const CLI::App& app, const Layers& layers);

// RIDGECAST_ and the flag in capitals, hyphens as underscores.
std::string variableOf(const std::string& key);

}  // namespace ridgecast::config
