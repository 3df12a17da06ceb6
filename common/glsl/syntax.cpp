#include "common/glsl/syntax.h"

#include <algorithm>
#include <array>

#include "common/glsl/complaints.h"
#include "common/outcome/contract.h"
#include "common/terrain/terrain.h"

namespace ridgecast::glsl {
namespace {

constexpr std::size_t kMaxTripsWrittenOut = 32;

constexpr std::array<std::string_view, 22> kTypes = {"float", "int",   "uint",  "bool",   "vec2",   "vec3",  "vec4",  "ivec2",
                                                     "ivec3", "ivec4", "uvec2", "uvec3",  "uvec4",  "bvec2", "bvec3", "bvec4",
                                                     "mat2",  "mat3",  "mat4",  "mat2x2", "mat3x3", "mat4x4"};
// Functions of what a picture has around a pixel, or of a texture, by their beginnings.
constexpr std::array<std::string_view, 4> kOfPictures = {"dFd", "fwidth", "texture", "texelFetch"};

bool isAssignment(const std::string& t) {
  return t == "=" || t == "+=" || t == "-=" || t == "*=" || t == "/=" || t == "%=" || t == "&=" || t == "|=" || t == "^=" || t == "<<=" ||
         t == ">>=" || t == "++" || t == "--";
}

// "xyz", "rgb" or "stp" letters as indices; empty if not a swizzle.
std::optional<std::vector<int>> swizzle(const std::string& name) {
  if (name.empty() || name.size() > 4) return std::nullopt;
  for (const std::string_view letters : {"xyzw", "rgba", "stpq"}) {
    std::vector<int> out;
    for (const char c : name)
      if (const auto k = letters.find(c); k != std::string_view::npos) out.push_back(static_cast<int>(k));
    if (out.size() == name.size()) return out;
  }
  return std::nullopt;
}

}  // namespace

const std::map<std::string, std::string>& preludeFunctions() {
  static const std::map<std::string, std::string> all = [] {
    std::map<std::string, std::string> results;
    const auto tokens = tokenise("prelude", withoutComments(terrain::prelude()));
    const auto items = tokens ? topLevel("prelude", *tokens) : Outcome<std::vector<TopLevel>>(tokens.error());
    expects(items.has_value(), "the prelude is GLSL");
    for (const TopLevel& item : *items)
      if (item.what == TopLevel::What::kFunction) results.emplace(item.names[0], (*tokens)[item.begin].text);
    return results;
  }();
  return all;
}

Syntax::Syntax(const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours) : tokens_(tokens), items_(items) {
  for (const TopLevel& item : items) expects(item.begin < item.end && item.end <= tokens.size(), "items are of these tokens");
  for (std::size_t i = 0; i + 2 < tokens_.size(); ++i) {
    if (!is(i, "struct") || !is(i + 2, "{")) continue;
    structs_.insert(tokens_[i + 1].text);
    const std::size_t close = closing(tokens_, i + 2);
    std::string type;  // of what is declared
    for (std::size_t k = i + 3; k < close; ++k) {
      if (is(k, "["))
        k = closing(tokens_, k);
      else if (isName(k) && (isName(k - 1) || is(k - 1, ",") || is(k - 1, "]")) && (is(k + 1, ";") || is(k + 1, ",") || is(k + 1, "[")))
        members_[tokens_[i + 1].text][tokens_[k].text] = type;
      else if (isName(k))
        type = tokens_[k].text;
    }
  }
  for (const TopLevel& item : items_)
    if (item.what == TopLevel::What::kFunction) functions_.insert(item.names[0]), writes(item);
  std::vector<std::string> ask{"terrainHeight"};
  if (colours) ask.push_back("terrainColor");
  if (functions_.contains("terrainMaterial")) ask.push_back("terrainMaterial");
  while (!ask.empty()) {
    const std::string name = std::move(ask.back());
    ask.pop_back();
    if (!wanted_.insert(name).second) continue;
    for (const TopLevel& item : items_) {
      if (std::ranges::find(item.names, name) == item.names.end()) continue;
      for (std::size_t i = item.begin; i < item.end; ++i)
        if (isName(i)) ask.push_back(tokens_[i].text);
      ask.insert(ask.end(), item.names.begin(), item.names.end());
    }
  }
}

bool Syntax::isType(std::size_t i) const {
  return isName(i) && !isLocal(tokens_[i].text) &&
         (std::ranges::find(kTypes, tokens_[i].text) != kTypes.end() || structs_.contains(tokens_[i].text));
}

std::vector<std::size_t> Syntax::elements(std::size_t open, std::size_t close) const {
  std::vector<std::size_t> ends;
  for (std::size_t i = open + 1; i < close; i = is(i, "(") || is(i, "[") || is(i, "{") ? closing(tokens_, i) + 1 : i + 1)
    if (is(i, ",")) ends.push_back(i);
  if (close > open + 1) ends.push_back(close);
  return ends;
}

void Syntax::writes(const TopLevel& f) {
  std::vector<bool> written;
  std::size_t begin = f.parameters + 1;
  for (const std::size_t end : elements(f.parameters, closing(tokens_, f.parameters))) {
    written.push_back(false);
    for (std::size_t i = begin; i < end; ++i)
      if (is(i, "out") || is(i, "inout")) written.back() = true;
    begin = end + 1;
  }
  written_.emplace(f.names[0], std::move(written));
}

double Syntax::inlined(const std::string& name) {
  if (const auto known = sizes_.find(name); known != sizes_.end()) return known->second;
  double size = 1;
  for (const TopLevel& item : items_) {
    if (item.what != TopLevel::What::kFunction || item.names[0] != name) continue;
    sizes_[name] = 1;  // overloads call one another at most
    for (std::size_t i = item.body; i < item.end; ++i) size += isName(i) && is(i + 1, "(") ? inlined(tokens_[i].text) : 1;
  }
  return sizes_[name] = size;
}

bool Syntax::isLocal(const std::string& name) const {
  return scopes_.size() > 1 && std::any_of(scopes_.begin() + 1, scopes_.end(), [&](const Scope& s) { return s.names.contains(name); });
}

std::optional<CountedLoop> Syntax::counted(std::size_t open, std::size_t close, std::size_t bodyEnd) const {
  std::size_t i = open + 1;
  CountedLoop loop;
  if (!is(i, "int") || !isName(i + 1) || !is(i + 2, "=")) return std::nullopt;
  loop.name = tokens_[i + 1].text;
  const auto first = number(i + 3);
  if (!first || !is(i + 4, ";") || !is(i + 5, loop.name) || !(is(i + 6, "<") || is(i + 6, "<="))) return std::nullopt;
  const auto last = number(i + 7);
  if (!last || !is(i + 8, ";")) return std::nullopt;
  const bool steps = (is(i + 9, loop.name) && is(i + 10, "++") && i + 11 == close) ||
                     (is(i + 9, "++") && is(i + 10, loop.name) && i + 11 == close) ||
                     (is(i + 9, loop.name) && is(i + 10, "+=") && is(i + 11, "1") && i + 12 == close);
  const long trips = *last - *first + (is(i + 6, "<=") ? 1 : 0);
  if (!steps || trips > static_cast<long>(kMaxTripsWrittenOut)) return std::nullopt;
  std::size_t called = 0;  // where the last call of what writes its arguments ends
  for (std::size_t k = close + 1; k < bodyEnd; ++k) {
    if (is(k, "break") || is(k, "continue")) return std::nullopt;
    if (isName(k) && is(k + 1, "(") && written_.contains(tokens_[k].text)) called = std::max(called, closing(tokens_, k + 1));
    if (!is(k, loop.name)) continue;
    if (k < called) return std::nullopt;        // which may change it
    std::size_t before = k - 1, after = k + 1;  // its own brackets
    for (; is(before, "(") && is(after, ")"); ++after) --before;
    if ((after < bodyEnd && isAssignment(tokens_[after].text)) || is(before, "++") || is(before, "--")) return std::nullopt;
  }
  loop.first = *first;
  loop.trips = static_cast<std::size_t>(std::max(trips, 0l));
  return loop;
}

std::optional<long> Syntax::number(std::size_t i) const {
  if (i >= tokens_.size()) return std::nullopt;
  if (tokens_[i].kind == Kind::kName) {
    if (isLocal(tokens_[i].text)) return std::nullopt;
    for (const TopLevel& item : items_)
      if (item.what == TopLevel::What::kConstant && item.end == item.begin + 6 && is(item.begin + 1, "int") &&
          is(item.begin + 2, tokens_[i].text) && tokens_[item.begin + 4].kind == Kind::kNumber)
        return number(item.begin + 4);
    return std::nullopt;
  }
  const std::string& t = tokens_[i].text;
  return t.size() > 1 && t[0] == '0' ? std::nullopt : text::number<long>(t);
}

std::size_t Syntax::statementEnd(std::size_t i) const {
  if (is(i, "{")) return std::min(closing(tokens_, i) + 1, tokens_.size());
  if (is(i, "for") || is(i, "while") || is(i, "if") || is(i, "switch")) {
    std::size_t end = statementEnd(closing(tokens_, i + 1) + 1);
    if (is(i, "if") && is(end, "else")) end = statementEnd(end + 1);
    return end;
  }
  if (is(i, "do")) {
    const std::size_t condition = statementEnd(i + 1) + 1;
    return std::min(closing(tokens_, condition) + 2, tokens_.size());
  }
  if (is(i, "else")) return statementEnd(i + 1);
  while (i < tokens_.size() && !is(i, ";")) i = is(i, "(") || is(i, "[") || is(i, "{") ? closing(tokens_, i) + 1 : i + 1;
  return std::min(i + 1, tokens_.size());
}

bool Syntax::isOfPictures(std::size_t i) const {
  return is(i + 1, "(") && !functions_.contains(tokens_[i].text) &&
         std::ranges::any_of(kOfPictures, [&](std::string_view name) { return tokens_[i].text.starts_with(name); });
}

bool Syntax::isStatement(std::size_t i) const {
  if (i == 0 || is(i - 1, ";") || is(i - 1, "{") || is(i - 1, "}") || is(i - 1, "else") || is(i - 1, "do")) return true;
  if (is(i - 1, ")")) {
    const std::size_t open = opening(i - 1);
    return open > 0 && (is(open - 1, "if") || is(open - 1, "for") || is(open - 1, "while"));
  }
  if (!is(i - 1, ":")) return false;
  for (std::size_t k = i - 1; k > 0 && !is(k - 1, ";") && !is(k - 1, "{") && !is(k - 1, "}"); --k)
    if (is(k - 1, "case") || is(k - 1, "default")) return true;
  return false;
}

std::vector<int> Syntax::selected(std::size_t dot) const {
  if (!isName(dot + 1) || members_.contains(typeBefore(dot))) return {};
  return swizzle(tokens_[dot + 1].text).value_or(std::vector<int>());
}

std::string Syntax::typeBefore(std::size_t end) const {
  if (end == 0) return {};
  if (is(end - 1, "]")) return typeBefore(opening(end - 1));
  if (is(end - 1, ")")) {
    const std::size_t open = opening(end - 1);
    if (open == 0) return {};
    if (is(open - 1, "]")) {  // Hit[2](a, b)
      const std::size_t size = opening(open - 1);
      expects(size > 0, "an array has a type");
      return tokens_[size - 1].text;
    }
    return isName(open - 1) && !is(open - 1, "return") ? resultOf(tokens_[open - 1].text) : typeBefore(end - 1);
  }
  if (!isName(end - 1)) return {};
  const std::string& name = tokens_[end - 1].text;
  if (end > 1 && is(end - 2, ".")) {
    const auto of = members_.find(typeBefore(end - 2));
    return of == members_.end() || !of->second.contains(name) ? std::string() : of->second.at(name);
  }
  for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope)
    if (const auto found = scope->types.find(name); found != scope->types.end()) return found->second;
  return {};
}

std::string Syntax::resultOf(const std::string& name) const {
  if (structs_.contains(name)) return name;
  for (const TopLevel& item : items_)
    if (item.what == TopLevel::What::kFunction && item.names[0] == name)
      for (std::size_t i = item.begin; i < item.parameters; ++i)
        if (structs_.contains(tokens_[i].text)) return tokens_[i].text;
  const auto ofPrelude = preludeFunctions().find(name);
  return ofPrelude == preludeFunctions().end() ? std::string() : ofPrelude->second;
}

bool Syntax::areAssigned(std::size_t dot, std::size_t after) const {
  std::size_t begin = dot;  // of a.b[i].xz
  while (begin > 0 && (isName(begin - 1) || is(begin - 1, ".") || is(begin - 1, "]") || is(begin - 1, ")")))
    begin = isName(begin - 1) || is(begin - 1, ".") ? begin - 1 : opening(begin - 1);
  for (;;) {
    while (is(after, "[")) after = closing(tokens_, after) + 1;
    const bool isCall = begin > 1 && isName(begin - 2) && !is(begin - 2, "return") && !is(begin - 2, "else") && !is(begin - 2, "do");
    if (begin == 0 || !is(begin - 1, "(") || !is(after, ")") || isCall) break;
    --begin, ++after;
  }
  return (after < tokens_.size() && isAssignment(tokens_[after].text)) || (begin > 0 && (is(begin - 1, "++") || is(begin - 1, "--")));
}

std::size_t Syntax::opening(std::size_t close) const {
  std::size_t depth = 1;
  while (close > 0 && depth > 0) {
    --close;
    depth += is(close, "]") || is(close, ")") || is(close, "}") ? 1u : 0u;
    depth -= is(close, "[") || is(close, "(") || is(close, "{") ? 1u : 0u;
  }
  expects(depth == 0, "brackets match");
  return close;
}

}  // namespace ridgecast::glsl
