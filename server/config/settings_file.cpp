#include "server/config/settings_file.h"

#include <toml++/toml.h>

#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>

namespace ridgecast::config {

namespace {

constexpr std::size_t kMaxFileBytes = 1u << 20;

std::optional<std::string> textOf(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* boolean = node.as_boolean()) return boolean->get() ? "true" : "false";
  if (const auto* real = node.as_floating_point()) {
    char out[40];
    std::snprintf(out, sizeof out, "%.17g", real->get());
    return out;
  }
  return std::nullopt;
}

}  // namespace

Outcome<std::vector<FileSetting>> readSettingsFile(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string text(kMaxFileBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (!in.eof() && in.gcount() == 0) return Error{"Cannot read the settings file '" + file.string() + "'."};
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > kMaxFileBytes) return Error{"The settings file '" + file.string() + "' is larger than a megabyte."};
  toml::table table;
  try {
    table = toml::parse(text);
  } catch (const toml::parse_error& e) {
    return Error{file.string() + ":" + std::to_string(e.source().begin.line) + ": " + std::string(e.description()) + "."};
  }
  std::vector<FileSetting> settings;
  for (const auto& [key, node] : table) {
    FileSetting setting;
    setting.key = key.str();
    setting.line = key.source().begin.line;
    const std::string where = file.string() + ":" + std::to_string(setting.line) + ": ";
    if (node.is_table() || node.is_array_of_tables())
      return Error{where + "'" + setting.key + "' is a section; settings stand one a line, such as max-cameras = 64."};
    if (const toml::array* list = node.as_array()) {
      setting.list = true;
      for (const toml::node& one : *list) {
        auto value = textOf(one);
        if (!value) return Error{where + "'" + setting.key + "' holds something that is neither text, number, true nor false."};
        setting.values.push_back(std::move(*value));
      }
    } else {
      auto value = textOf(node);
      if (!value) return Error{where + "'" + setting.key + "' is neither text, number, true, false nor a list of these."};
      setting.values.push_back(std::move(*value));
    }
    settings.push_back(std::move(setting));
  }
  return settings;
}

}  // namespace ridgecast::config
