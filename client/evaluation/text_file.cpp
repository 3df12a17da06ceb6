#include "client/evaluation/text_file.h"

#include <fstream>
#include <sstream>

namespace ridgecast::evaluation {

Error cannotWrite(const std::filesystem::path& file) {
  return {"cannot write " + file.string() + ": choose a folder that exists, may be written and has room"};
}

Outcome<void> writeText(const std::filesystem::path& file, std::string_view text) {
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out << text;
  out.close();
  if (!out) return cannotWrite(file);
  return {};
}

std::string readText(const std::filesystem::path& file) {
  std::ostringstream out;
  out << std::ifstream(file, std::ios::binary).rdbuf();
  return out.str();
}

}  // namespace ridgecast::evaluation
