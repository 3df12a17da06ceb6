#pragma once
// Whole small files.

#include <filesystem>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

Error cannotWrite(const std::filesystem::path& file);
Outcome<void> writeText(const std::filesystem::path& file, std::string_view text);
std::string readText(const std::filesystem::path& file);  // empty when it cannot be read

}  // namespace ridgecast::evaluation
