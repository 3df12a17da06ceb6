#include "server/config/layers.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <string_view>

#include "server/config/settings_file.h"

namespace ridgecast::config {

namespace {

constexpr std::string_view kPrefix = "RIDGECAST_";
// Settings of ./run, which people export.
constexpr std::array<std::string_view, 2> kOthers{"RIDGECAST_NO_INSTALL", "RIDGECAST_JOBS"};

std::string keyOf(const CLI::Option& option) { return option.get_lnames().empty() ? std::string() : option.get_lnames().front(); }
bool isSetting(const CLI::Option& option) { return option.get_configurable() && !option.get_lnames().empty(); }
bool isList(const CLI::Option& option) { return option.get_items_expected_max() > 1; }
bool isFlag(const CLI::Option& option) { return option.get_items_expected_max() == 0 || option.get_type_size_max() == 0; }

std::optional<std::string> set(CLI::Option& option, const std::vector<std::string>& values) {
  try {
    for (const std::string& value : values) option.add_result(value);
    if (!values.empty()) option.run_callback();
    return std::nullopt;
  } catch (const CLI::Error& e) {
    return e.what();
  }
}

std::vector<std::string> split(std::string_view text) {
  std::vector<std::string> parts;
  while (!text.empty()) {
    const auto end = std::min(text.find(','), text.size());
    if (end > 0) parts.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parts;
}

// As TOML: numbers and booleans bare, everything else in quotation marks.
std::string literal(const std::string& value) {
  const bool number = !value.empty() && value.size() < 19 &&
                      std::all_of(value.begin(), value.end(), [](char c) { return c >= '0' && c <= '9'; }) &&
                      (value.size() == 1 || value.front() != '0');
  if (number || value == "true" || value == "false") return value;
  std::string out = "\"";
  for (const char c : value) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(c));
      out += escape;
      continue;
    }
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

}  // namespace

std::string variableOf(const std::string& key) {
  std::string name(kPrefix);
  for (const char c : key) name += c == '-' ? '_' : c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  return name;
}

Outcome<Sources> addLayers(CLI::App& app, const std::filesystem::path& file, const char* const* environment) {
  Sources sources;
  std::map<std::string, CLI::Option*> byKey, byVariable;
  for (CLI::Option* option : app.get_options()) {
    if (!isSetting(*option)) continue;
    const std::string key = keyOf(*option);
    byKey[key] = byVariable[variableOf(key)] = option;
    sources[key] = option->count() > 0 ? "flag" : "default";
  }
  for (; *environment; ++environment) {
    const std::string_view entry = *environment;
    if (!entry.starts_with(kPrefix)) continue;
    const std::string name(entry.substr(0, entry.find('=')));
    if (name == variableOf("config") || std::find(kOthers.begin(), kOthers.end(), name) != kOthers.end()) continue;
    const auto found = byVariable.find(name);
    if (found == byVariable.end())
      return Error{"The environment's " + name + " is not a setting of this server; --print-config lists the settings."};
    std::string& source = sources[keyOf(*found->second)];
    if (source == "flag") continue;
    const std::string value(entry.substr(std::min(name.size() + 1, entry.size())));
    if (auto wrong = set(*found->second, isList(*found->second) ? split(value) : std::vector{value}))
      return Error{"The environment's " + name + " is wrong: " + *wrong + "."};
    source = "environment " + name;
  }
  if (file.empty()) return sources;
  const auto settings = readSettingsFile(file);
  if (!settings) return settings.error();
  for (const FileSetting& setting : *settings) {
    const std::string where = file.string() + ":" + std::to_string(setting.line);
    const auto found = byKey.find(setting.key);
    if (found == byKey.end())
      return Error{where + ": '" + setting.key + "' is not a setting of this server; --print-config lists the settings."};
    if (setting.list && !isList(*found->second)) return Error{where + ": '" + setting.key + "' takes one value, not a list."};
    std::string& source = sources[setting.key];
    if (source != "default") continue;
    if (auto wrong = set(*found->second, setting.values)) return Error{where + ": " + *wrong + "."};
    source = "file " + where;
  }
  return sources;
}

std::string describe(const CLI::App& app, const Sources& sources) {
  std::string out;
  for (const CLI::Option* option : app.get_options()) {
    if (!isSetting(*option)) continue;
    const std::string key = keyOf(*option);
    std::string value;
    if (isList(*option)) {
      for (const std::string& one : option->results()) value += (value.empty() ? "" : ", ") + literal(one);
      value = "[" + value + "]";
    } else if (option->count() > 0) {
      value = isFlag(*option) ? (option->as<bool>() ? "true" : "false") : literal(option->results().back());
    } else {
      value = isFlag(*option) ? "false" : literal(option->get_default_str());
    }
    std::string line = key + " = " + value;
    line.resize(std::max<std::size_t>(line.size() + 2, 44), ' ');
    out += line + "# " + sources.at(key) + "\n";
  }
  return out;
}

}  // namespace ridgecast::config
