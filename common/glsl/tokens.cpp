#include "common/glsl/tokens.h"

#include <algorithm>
#include <array>

#include "common/glsl/complaints.h"
#include "common/outcome/contract.h"

namespace ridgecast::glsl {
namespace {

bool isDigit(char c) { return c >= '0' && c <= '9'; }
bool isNameStart(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }

constexpr std::array<std::string_view, 23> kLongMarks = {"<<=", ">>=", "++", "--", "<=", ">=", "==", "!=", "&&", "||", "^^", "<<",
                                                         ">>",  "+=",  "-=", "*=", "/=", "%=", "&=", "|=", "^=", "//", "/*"};
constexpr std::string_view kMarks = "+-*/%<>=!&|^~?:;,.()[]{}";

// The first bracket that does not close what was opened, or the last that is not closed; tokens.size(): none.
std::size_t lonely(const std::vector<Token>& tokens) {
  constexpr std::string_view kOpening = "([{", kClosing = ")]}";
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < tokens.size(); ++i) {
    if (tokens[i].kind != Kind::kMark || tokens[i].text.size() != 1) continue;
    if (kOpening.find(tokens[i].text) != kOpening.npos) open.push_back(i);
    const std::size_t kind = kClosing.find(tokens[i].text);
    if (kind == kClosing.npos) continue;
    if (open.empty() || tokens[open.back()].text[0] != kOpening[kind]) return i;
    open.pop_back();
  }
  return open.empty() ? tokens.size() : open.back();
}

}  // namespace

bool isNameCharacter(char c) { return isNameStart(c) || isDigit(c); }

std::string at(std::string_view file, std::size_t line) { return std::string(file) + ":" + std::to_string(line) + ": "; }

bool isPrecision(const std::string& name) { return name == "highp" || name == "mediump" || name == "lowp"; }

Outcome<std::vector<Token>> tokenise(std::string_view file, std::string_view text) {
  std::vector<Token> out;
  std::size_t line = 1;
  bool lineBegins = true;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '\n') {
      ++line, ++i;
      lineBegins = true;
      continue;
    }
    if (c == ' ' || c == '\t' || c == '\r' || c == '\f' || c == '\v') {
      ++i;
      continue;
    }
    if (c == '#' && lineBegins) {
      i = std::min(text.find('\n', i), text.size());
      continue;
    }
    lineBegins = false;
    std::size_t end = i + 1;
    if (isNameStart(c)) {
      while (end < text.size() && isNameCharacter(text[end])) ++end;
      out.push_back({Kind::kName, std::string(text.substr(i, end - i)), line});
    } else if (isDigit(c) || (c == '.' && end < text.size() && isDigit(text[end]))) {
      const bool hexadecimal = c == '0' && end < text.size() && (text[end] == 'x' || text[end] == 'X');
      while (end < text.size() &&
             (isNameCharacter(text[end]) || text[end] == '.' ||
              (!hexadecimal && (text[end] == '+' || text[end] == '-') && (text[end - 1] == 'e' || text[end - 1] == 'E'))))
        ++end;
      out.push_back({Kind::kNumber, std::string(text.substr(i, end - i)), line});
    } else {
      const auto longer = std::ranges::find_if(kLongMarks, [&](std::string_view m) { return text.substr(i).starts_with(m); });
      if (longer != kLongMarks.end())
        end = i + longer->size();
      else if (kMarks.find(c) == std::string_view::npos)
        return Error{at(file, line) + "there is a character here that GLSL does not have"};
      out.push_back({Kind::kMark, std::string(text.substr(i, end - i)), line});
    }
    i = end;
  }
  return out;
}

std::size_t closing(const std::vector<Token>& tokens, std::size_t open) {
  std::size_t depth = 0;
  for (std::size_t i = open; i < tokens.size(); ++i) {
    if (tokens[i].kind != Kind::kMark || tokens[i].text.size() != 1) continue;
    const char c = tokens[i].text[0];
    if (c == '(' || c == '[' || c == '{') ++depth;
    if ((c == ')' || c == ']' || c == '}') && --depth == 0) return i;
  }
  return tokens.size();
}

Outcome<std::vector<TopLevel>> topLevel(std::string_view file, const std::vector<Token>& tokens) {
  std::vector<TopLevel> out;
  const auto is = [&](std::size_t i, std::string_view text) { return i < tokens.size() && tokens[i].text == text; };
  const auto isName = [&](std::size_t i) { return i < tokens.size() && tokens[i].kind == Kind::kName; };
  const auto isOpening = [&](std::size_t i) { return is(i, "(") || is(i, "[") || is(i, "{"); };
  const auto after = [&](std::size_t i) { return isOpening(i) ? closing(tokens, i) + 1 : i + 1; };  // brackets as one
  const auto statementEnd = [&](std::size_t i) {
    while (i < tokens.size() && !is(i, ";")) i = after(i);
    return std::min(i + 1, tokens.size());
  };
  if (const std::size_t k = lonely(tokens); k < tokens.size())
    return Error{at(file, tokens[k].line) + "'" + tokens[k].text + "' has no partner: brackets open and close in the file"};
  std::vector<std::string> wrong;
  using enum TopLevel::What;
  std::size_t past = 0;  // all before it are read
  for (std::size_t i = 0; i < tokens.size();) {
    expects(i >= past, "each declaration ends after it begins");
    past = i + 1;
    const std::size_t begin = i, line = tokens[i].line;
    const auto refuse = [&](const std::string& what) { wrong.push_back(at(file, line) + what); };
    if (is(i, ";") || is(i, "precision")) {
      i = statementEnd(i);
      continue;
    }
    if (is(i, "struct")) {
      const std::size_t close = is(i + 2, "{") ? closing(tokens, i + 2) : tokens.size();
      if (!isName(i + 1) || !is(close + 1, ";")) {
        refuse("a struct is declared by itself, with a name and without variables");
        i = statementEnd(i);
        continue;
      }
      i = close + 2;
      out.push_back({kStruct, {tokens[begin + 1].text}, line, begin, i});
      continue;
    }
    if (is(i, "const")) {
      i = statementEnd(i);
      out.push_back({kConstant, {}, line, begin, i});
      for (std::size_t k = begin; k < i; k = after(k))
        if (isName(k) && (is(k + 1, "=") || (is(k + 1, "[") && is(after(k + 1), "=")))) out.back().names.push_back(tokens[k].text);
      continue;
    }
    // A function: qualifiers, type, optional [n], name, parameters.
    std::size_t open = i;
    while (isName(open)) ++open;
    if (is(open, "[") && isName(closing(tokens, open) + 1)) open = closing(tokens, open) + 2;
    if (is(open, "(") && open >= begin + 2) {
      const std::size_t close = closing(tokens, open);
      const bool defined = is(close + 1, "{");
      i = std::min(defined ? closing(tokens, close + 1) + 1 : statementEnd(close), tokens.size());
      out.push_back({defined ? kFunction : kPrototype, {tokens[open - 1].text}, line, begin, i, open, defined ? close + 1 : 0});
      continue;
    }
    const std::size_t end = is(open, "[") ? after(open) : open;
    const bool isValue = open >= begin + 2 && is(end, "=");
    std::string declared;
    for (std::size_t k = begin; isValue && k < end; ++k)
      declared += tokens[k].text + (is(k, "[") || is(k + 1, "[") || is(k + 1, "]") ? "" : " ");
    refuse("at its top level a terrain file has functions, structs and constants only; " +
           (isValue ? "write: const " + declared + "= ..."
                    : "for a value that people may set write: const float name = 1.0;  //! 0..2 m: what it is"));
    i = statementEnd(i);
  }
  if (!wrong.empty()) return joined(file, std::move(wrong));
  return out;
}

std::string signatureOf(const std::vector<Token>& tokens, const TopLevel& function) {
  expects(function.parameters < tokens.size() && tokens[function.parameters].text == "(", "a signature is a function's");
  std::string out;
  for (std::size_t i = function.begin; i < function.parameters; ++i)
    if (!isPrecision(tokens[i].text)) out.append(out.empty() ? "" : " ").append(tokens[i].text);
  out += "(";
  const std::size_t close = closing(tokens, function.parameters);
  std::string current;
  bool hasType = false;
  for (std::size_t i = function.parameters + 1; i <= close && i < tokens.size(); ++i) {
    const std::string& t = tokens[i].text;
    if (t == "," || i == close) {
      if (!current.empty() && current != "void") out.append(out.ends_with("(") ? "" : ", ").append(current);
      current.clear();
      hasType = false;
    } else if (isPrecision(t) || t == "in" || t == "const") {
      continue;
    } else if (t == "out" || t == "inout") {
      current.append(t).append(" ");
    } else if (!hasType) {
      current += t;
      hasType = true;
    } else if (tokens[i].kind != Kind::kName) {
      current += t;  // of an array
    }
  }
  return out + ")";
}

}  // namespace ridgecast::glsl
