#include "server/config/layers.h"

#include <toml++/toml.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <regex>
#include <string_view>
#include <vector>

#include "common/text/file.h"
#include "common/text/text.h"

namespace ridgecast::config {

namespace {

constexpr std::string_view kPrefix = "RIDGECAST_";
// Settings of ./run, which people export.
constexpr std::array<std::string_view, 2> kOthers{"RIDGECAST_NO_INSTALL", "RIDGECAST_JOBS"};

// What Kubernetes sets in each container for a Service: NAME_SERVICE_HOST, NAME_SERVICE_PORT[_PORTNAME], NAME_PORT=tcp://ADDRESS:PORT and
// NAME_PORT_7070_TCP[_PROTO|_PORT|_ADDR].
bool isOfAService(const std::string& name, const std::string& value) {
  static const std::regex names("RIDGECAST(_.*)?_(SERVICE_HOST|SERVICE_PORT(_.*)?|PORT_[0-9]+_(TCP|UDP|SCTP)(_(PROTO|PORT|ADDR))?)");
  static const std::regex url("(tcp|udp|sctp)://.*");
  return std::regex_match(name, names) || (name.ends_with("_PORT") && std::regex_match(value, url));
}

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
  while (!text.empty())
    if (const auto part = text::takePart(text, ','); !part.empty()) parts.emplace_back(part);
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

// A line of a settings file: TOML, one `key = value` a line, without sections. Keys are the long flags without leading hyphens.
struct FileSetting {
  std::string key;
  std::vector<std::string> values;  // as a flag would have them
  bool list = false;                // was written with brackets
  unsigned line = 0;
};

constexpr std::size_t kMaxFileBytes = 1u << 20;

std::optional<std::string> textOf(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* boolean = node.as_boolean()) return boolean->get() ? "true" : "false";
  if (const auto* real = node.as_floating_point()) return text::rounded(real->get(), 17);
  return std::nullopt;
}

// Error: unreadable, larger than 1 MiB, not TOML, a section, or a value that is not text, number, true, false or a list of these.
Outcome<std::vector<FileSetting>> readSettingsFile(const std::filesystem::path& file) {
  const auto text = text::readFile(file, kMaxFileBytes);
  if (!text) return Error{"Cannot read the settings file '" + file.string() + "'."};
  if (text->size() > kMaxFileBytes) return Error{"The settings file '" + file.string() + "' is larger than a megabyte."};
  toml::table table;
  try {
    table = toml::parse(*text);
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
      return Error{where + "'" + setting.key + "' is a section; settings are one a line, such as max-cameras = 64."};
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

}  // namespace

std::string variableOf(const std::string& key) {
  std::string name(kPrefix);
  for (const char c : key) name += c == '-' ? '_' : c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
  return name;
}

Outcome<Layers> addLayers(CLI::App& app, const std::filesystem::path& file, const char* const* environment) {
  Layers layers;
  auto& sources = layers.sources;
  std::map<std::string, CLI::Option*> byKey, byVariable;
  for (CLI::Option* option : app.get_options()) {
    if (!isSetting(*option)) continue;
    for (const std::string& name : option->get_lnames()) byKey[name] = byVariable[variableOf(name)] = option;
    sources[keyOf(*option)] = option->count() > 0 ? "flag" : "default";
  }
  for (; *environment; ++environment) {
    const std::string_view entry = *environment;
    if (!entry.starts_with(kPrefix)) continue;
    const std::string name(entry.substr(0, entry.find('='))), value(entry.substr(std::min(name.size() + 1, entry.size())));
    if (name == variableOf("config") || std::find(kOthers.begin(), kOthers.end(), name) != kOthers.end()) continue;
    if (isOfAService(name, value)) {
      layers.ignored.push_back(name);
      continue;
    }
    const auto found = byVariable.find(name);
    if (found == byVariable.end())
      return Error{"The environment's " + name + " is not a setting of this server; --print-config lists the settings."};
    std::string& source = sources[keyOf(*found->second)];
    if (source == "flag") continue;
    if (auto wrong = set(*found->second, isList(*found->second) ? split(value) : std::vector{value}))
      return Error{"The environment's " + name + " is wrong: " + *wrong + "."};
    source = "environment " + name;
  }
  if (file.empty()) return layers;
  const auto settings = readSettingsFile(file);
  if (!settings) return settings.error();
  for (const FileSetting& setting : *settings) {
    const std::string where = file.string() + ":" + std::to_string(setting.line);
    const auto found = byKey.find(setting.key);
    if (found == byKey.end())
      return Error{where + ": '" + setting.key + "' is not a setting of this server; --print-config lists the settings."};
    if (setting.list && !isList(*found->second)) return Error{where + ": '" + setting.key + "' takes one value, not a list."};
    std::string& source = sources[keyOf(*found->second)];
    if (source != "default") continue;
    if (auto wrong = set(*found->second, setting.values)) return Error{where + ": " + *wrong + "."};
    source = "file " + where;
  }
  return layers;
}

namespace {

// A URL's password is nobody's to read over a shoulder.
std::string withoutPassword(const std::string& url) {
  const auto scheme = url.find("://"), at = url.rfind('@');
  if (scheme == std::string::npos || at == std::string::npos || at < scheme) return url;
  const auto colon = url.find(':', scheme + 3);
  return colon < at ? url.substr(0, colon + 1) + "..." + url.substr(at) : url;
}

}  // namespace

std::string describe(const CLI::App& app, const Layers& layers) {
  std::string out;
  for (const CLI::Option* option : app.get_options()) {
    if (!isSetting(*option)) continue;
    const std::string key = keyOf(*option);
    std::string value;
    if (isList(*option)) {
      for (const std::string& one : option->results()) value += (value.empty() ? "" : ", ") + literal(one);
      value = "[" + value + "]";
    } else if (option->count() > 0) {
      value = isFlag(*option) ? (option->as<bool>() ? "true" : "false") : literal(withoutPassword(option->results().back()));
    } else {
      value = isFlag(*option) ? "false" : literal(option->get_default_str());
    }
    std::string line = key + " = " + value;
    line.resize(std::max<std::size_t>(line.size() + 2, 44), ' ');
    out += line + "# " + layers.sources.at(key) + "\n";
  }
  return out;
}

}  // namespace ridgecast::config
