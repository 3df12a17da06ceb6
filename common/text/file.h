#pragma once
// Reading small files; any thread.

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace ridgecast::text {

// A file's bytes; of a file with more than `most`, the first most + 1. Nothing: it cannot be read.
std::optional<std::string> readFile(const std::filesystem::path& file, std::size_t most);

}  // namespace ridgecast::text
