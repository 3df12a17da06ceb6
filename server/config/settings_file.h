#pragma once
// A settings file: TOML, one `key = value` a line, without sections. Keys are the long flags without leading hyphens.

#include <filesystem>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::config {

struct FileSetting {
  std::string key;
  std::vector<std::string> values;  // as a flag would have them
  bool list = false;                // was written with brackets
  unsigned line = 0;
};

// Error: unreadable, larger than 1 MiB, not TOML, a section, or a value that is not text, number, true, false or a list of these.
Outcome<std::vector<FileSetting>> readSettingsFile(const std::filesystem::path& file);

}  // namespace ridgecast::config
