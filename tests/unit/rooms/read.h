#pragma once
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace ridgecast {

inline std::string read(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace ridgecast
