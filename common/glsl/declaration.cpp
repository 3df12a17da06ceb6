#include "common/glsl/declaration.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

#include "common/glsl/tokens.h"
#include "common/outcome/contract.h"
#include "common/terrain/materials.h"

namespace ridgecast::glsl {
namespace {

// Takes a number off the front of s.
std::optional<double> takeNumber(std::string_view& s) {
  if (s.starts_with('+')) s.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(s.data(), s.data() + s.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  s.remove_prefix(static_cast<std::size_t>(end - s.data()));
  return value;
}

std::optional<double> wholeNumber(std::string_view s) {
  s = trimmed(s);
  const auto value = takeNumber(s);
  return s.empty() ? value : std::nullopt;
}

bool takeWord(std::string_view& s, std::string_view word) {
  s = trimmed(s);
  if (!s.starts_with(word) || (s.size() > word.size() && isNameCharacter(s[word.size()]))) return false;
  s.remove_prefix(word.size());
  return true;
}

// code: the text before //! ; comment: the text after it. Empty if they do not form a parameter.
std::optional<Parameter> readParameter(std::string_view code, std::string_view comment, const char* text) {
  Parameter p;
  if (!takeWord(code, "const") || !takeWord(code, "float")) return std::nullopt;
  code = trimmed(code);
  const std::size_t name = std::min(code.size(), static_cast<std::size_t>(std::ranges::find_if_not(code, isNameCharacter) - code.begin()));
  p.name = code.substr(0, name);
  code = trimmed(code.substr(name));
  if (p.name.empty() || !code.starts_with('=')) return std::nullopt;
  code = trimmed(code.substr(1));
  p.begin = static_cast<std::size_t>(code.data() - text);
  const auto value = takeNumber(code);
  if (!value) return std::nullopt;
  if (code.starts_with('f') || code.starts_with('F')) code.remove_prefix(1);
  p.end = static_cast<std::size_t>(code.data() - text);
  if (trimmed(code) != ";") return std::nullopt;

  const std::size_t dots = comment.find(".."), colon = comment.find(':');
  if (dots == std::string_view::npos || colon == std::string_view::npos || colon < dots) return std::nullopt;
  const auto least = wholeNumber(comment.substr(0, dots));
  std::string_view rest = trimmed(comment.substr(dots + 2, colon - dots - 2));
  const auto most = takeNumber(rest);
  if (!least || !most) return std::nullopt;
  p.value = *value;
  p.least = *least;
  p.most = *most;
  p.unit = trimmed(rest);
  p.summary = trimmed(comment.substr(colon + 1));
  return p;
}

constexpr std::string_view kMaterialsLine = "materials:";

Outcome<std::vector<std::string>> readMaterials(const std::string& where, std::string_view names) {
  std::vector<std::string> out;
  while (!trimmed(names).empty()) {
    const std::string name(trimmed(text::takePart(names, ',')));
    if (!terrain::isMaterialName(name))
      return Error{where + "'" + name + "' names no material: 1 to 32 of a-z 0-9 _ -, with commas between"};
    if (const auto shared = terrain::materialNumber(name))
      return Error{where + name + " is number " + std::to_string(shared) + " on every terrain: leave it out here"};
    if (terrain::materialNumber(name, out) != 0) return Error{where + name + " is there twice"};
    out.push_back(name);
  }
  if (out.empty() || out.size() > terrain::kMaxOwnMaterials)
    return Error{where + "materials are 1 to " + std::to_string(terrain::kMaxOwnMaterials) + " names, the first of number " +
                 std::to_string(terrain::kMaterials.size() + 1)};
  return {boost::system::in_place_value, std::move(out)};
}

constexpr const char* kOfThisText = "a declaration goes with the text that it was read from";

std::string shortNumber(double v) { return text::rounded(v, 9); }

}  // namespace

Outcome<Assignment> parseAssignment(std::string_view text) {
  const std::size_t equals = text.find('=');
  const auto value = equals == std::string_view::npos ? std::nullopt : wholeNumber(text.substr(equals + 1));
  if (!value || equals == 0) return Error{"--param: '" + std::string(text) + "' is not NAME=NUMBER, such as snowLine=1800"};
  return Assignment{std::string(trimmed(text.substr(0, equals))), *value};
}

Outcome<Declaration> readDeclaration(std::string_view file, std::string_view text) {
  Declaration out;
  std::size_t number = 0;
  for (std::string_view rest = text; !rest.empty();) {
    const std::string_view line = text::takePart(rest, '\n');
    ++number;
    const std::size_t mark = line.find("//!");
    if (mark == std::string_view::npos) continue;
    const std::string_view code = trimmed(line.substr(0, mark)), comment = trimmed(line.substr(mark + 3));
    if (code.empty() && comment.starts_with(kMaterialsLine)) {
      if (auto named = readMaterials(at(file, number), comment.substr(kMaterialsLine.size())); !named || !out.materials.empty())
        return named ? Error{at(file, number) + "there is one line of materials"} : named.error();
      else
        out.materials = std::move(*named);
      continue;
    }
    if (code.empty()) {
      if (out.summary.empty()) out.summary = comment;
      continue;
    }
    const std::string where = at(file, number);
    auto parameter = readParameter(code, comment, text.data());
    if (!parameter)
      return Error{where +
                   "a comment that begins with //! after code declares a parameter, such as: const float snowLine = 1800.0;  //! 0..4000 "
                   "m: height of the snow line"};
    if (!(parameter->least <= parameter->value && parameter->value <= parameter->most))
      return Error{where + "the default of " + parameter->name + ", " + shortNumber(parameter->value) + ", lies outside its range " +
                   shortNumber(parameter->least) + ".." + shortNumber(parameter->most)};
    out.parameters.push_back(std::move(*parameter));
  }
  return out;
}

Outcome<std::string> withParameters(std::string_view file, std::string_view text, const Declaration& declaration,
                                    const std::vector<Assignment>& assignments) {
  std::vector<Parameter> changed;
  for (const auto& [name, value] : assignments) {
    const auto p = std::ranges::find(declaration.parameters, name, &Parameter::name);
    if (p == declaration.parameters.end()) {
      std::string names;
      for (const Parameter& known : declaration.parameters) names.append(names.empty() ? "" : ", ").append(known.name);
      return Error{std::string(file) + " has no parameter '" + name + "'; " + (names.empty() ? "it has none" : "it has: " + names)};
    }
    if (!(value >= p->least && value <= p->most))
      return Error{"--param " + name + "=" + shortNumber(value) + " is out of range: it must be from " + shortNumber(p->least) + " to " +
                   shortNumber(p->most) + (p->unit.empty() ? "" : " " + p->unit)};
    std::erase_if(changed, [&wanted = name](const Parameter& c) { return c.name == wanted; });  // the last one counts
    changed.push_back(*p);
    changed.back().value = value;
  }
  std::ranges::sort(changed, std::greater{}, &Parameter::begin);
  std::string out(text);
  for (const Parameter& p : changed) {
    expects(p.begin < p.end && p.end <= text.size(), kOfThisText);
    std::string literal = shortNumber(p.value);
    if (literal.find_first_of(".e") == std::string::npos) literal += ".0";
    out.replace(p.begin, p.end - p.begin, literal + "f");
  }
  return {boost::system::in_place_value, std::move(out)};
}

std::vector<float> valuesOf(std::string_view text, const Declaration& declaration) {
  std::vector<float> out;
  for (const Parameter& p : declaration.parameters) {
    expects(p.begin < p.end && p.end <= text.size(), kOfThisText);
    // From the text, as compilers read it: a double between would be rounded twice.
    std::from_chars(text.data() + p.begin, text.data() + p.end, out.emplace_back());
  }
  return out;
}

std::string describe(const Parameter& p) {
  return p.name + " = " + shortNumber(p.value) + (p.unit.empty() ? "" : " " + p.unit) + " (" + shortNumber(p.least) + ".." +
         shortNumber(p.most) + "): " + p.summary;
}

}  // namespace ridgecast::glsl
