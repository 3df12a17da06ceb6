#pragma once
// Whole small files.

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>

#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

inline Error cannotWrite(const std::filesystem::path& file) {
  return {"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
}

inline Outcome<void> writeText(const std::filesystem::path& file, std::string_view text) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << text;
  out.close();
  if (!out) return cannotWrite(file);
  return {};
}

// Empty when it cannot be read.
inline std::string readText(const std::filesystem::path& file) {
  std::ostringstream out;
  out << std::ifstream(file, std::ios::binary).rdbuf();
  return out.str();
}

}  // namespace ridgecast::evaluation
