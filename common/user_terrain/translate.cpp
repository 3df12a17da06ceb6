#include "common/user_terrain/translate.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>

#include "common/outcome/contract.h"
#include "common/terrain/terrain.h"
#include "common/user_terrain/complaints.h"

namespace ridgecast::user_terrain {
namespace {

constexpr std::size_t kMaxTripsWrittenOut = 32;
constexpr double kMaxInlined = 300'000;     // words; g++ takes about a minute for this many
constexpr std::size_t kMaxTokens = 60'000;  // of the translation; loops that would exceed it are not unrolled

// Reserved in C++ but not in GLSL, each between spaces.
constexpr std::string_view kClaimed =
    " alignas alignof and and_eq auto bitand bitor catch char char16_t char32_t char8_t co_await co_return co_yield compl "
    "concept const_cast consteval constexpr constinit decltype delete dynamic_cast explicit export friend mutable new "
    "noexcept not not_eq nullptr operator or or_eq private protected register reinterpret_cast requires signed static_assert "
    "static_cast thread_local throw try typeid typename virtual wchar_t xor xor_eq ";

constexpr std::array<std::string_view, 22> kTypes = {"float", "int",   "uint",  "bool",   "vec2",   "vec3",  "vec4",  "ivec2",
                                                     "ivec3", "ivec4", "uvec2", "uvec3",  "uvec4",  "bvec2", "bvec3", "bvec4",
                                                     "mat2",  "mat3",  "mat4",  "mat2x2", "mat3x3", "mat4x4"};
// Functions of what a picture has around a pixel, or of a texture, by their beginnings.
constexpr std::array<std::string_view, 4> kOfPictures = {"dFd", "fwidth", "texture", "texelFetch"};
constexpr std::array<std::string_view, 6> kOblong = {"mat2x3", "mat2x4", "mat3x2", "mat3x4", "mat4x2", "mat4x3"};

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

// What they return, by their names. A file's overloads of these stand beside the prelude's.
const std::map<std::string, std::string>& preludeFunctions() {
  static const std::map<std::string, std::string> all = [] {
    std::map<std::string, std::string> results;
    const auto tokens = tokenise("prelude", withoutComments(terrain::prelude()));
    const auto items = tokens ? topLevel("prelude", *tokens) : Outcome<std::vector<TopLevel>>(tokens.error());
    expects(items.has_value(), "an expression has its parts");
    for (const TopLevel& item : *items)
      if (item.what == TopLevel::What::kFunction) results.emplace(item.names[0], (*tokens)[item.begin].text);
    return results;
  }();
  return all;
}

struct CountedLoop {
  std::string name;
  long first = 0;
  std::size_t trips = 0;
};

class Translator {
 public:
  Translator(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours)
      : file_(file), tokens_(tokens), items_(items) {
    out_.colours = colours;
  }

  Outcome<Translation> run() {
    collect();
    for (const std::string name : {"terrainHeight", "terrainColor"})
      if (const double size = inlined(name); size > kMaxInlined && (out_.colours || name == "terrainHeight"))
        return Error{std::string(file_) + ": with all its calls written out " + name + " would be " +
                     std::to_string(static_cast<long long>(std::min(size, 1e15))) + " words long; it calls too much: write it shorter"};
    for (const std::string& name : functions_)
      if (preludeFunctions().contains(name) && wanted_.contains(name)) out_.text.append("using ::").append(name).append(";\n");
    scopes_.emplace_back();  // of the file
    for (const TopLevel& item : items_) {
      if (std::ranges::none_of(item.names, [&](const std::string& n) { return wanted_.contains(n); })) continue;
      if (item.what == TopLevel::What::kFunction || item.what == TopLevel::What::kPrototype) {
        emit(item.begin, item.parameters);
        scopes_.emplace_back();
        parameters(item);
        emit(closing(tokens_, item.parameters), item.end);
        scopes_.pop_back();
      } else {
        emit(item.begin, item.end);
      }
    }
    if (!wrong_.empty()) return joined(file_, std::move(wrong_));
    if (emitted_ > 4 * kMaxTokens) return Error{std::string(file_) + ": this is too much for one terrain: write it shorter"};
    out_.text += "\n";
    return std::move(out_);
  }

 private:
  bool is(std::size_t i, std::string_view text) const { return i < tokens_.size() && tokens_[i].text == text; }
  bool isName(std::size_t i) const { return i < tokens_.size() && tokens_[i].kind == Kind::kName; }
  bool isType(std::size_t i) const {
    return isName(i) && !isLocal(tokens_[i].text) &&
           (std::ranges::find(kTypes, tokens_[i].text) != kTypes.end() || structs_.contains(tokens_[i].text));
  }

  // Names of structs and members, and everything that terrainHeight reaches.
  void collect() {
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
    if (out_.colours) ask.push_back("terrainColor");
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

  // Ends of the elements between two brackets.
  std::vector<std::size_t> elements(std::size_t open, std::size_t close) const {
    std::vector<std::size_t> ends;
    for (std::size_t i = open + 1; i < close; i = is(i, "(") || is(i, "[") || is(i, "{") ? closing(tokens_, i) + 1 : i + 1)
      if (is(i, ",")) ends.push_back(i);
    if (close > open + 1) ends.push_back(close);
    return ends;
  }

  // Which arguments a function writes.
  void writes(const TopLevel& f) {
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

  // Words of the functions of this name with all calls inlined, as the compiler does it.
  double inlined(const std::string& name) {
    if (const auto known = sizes_.find(name); known != sizes_.end()) return known->second;
    double size = 1;
    for (const TopLevel& item : items_) {
      if (item.what != TopLevel::What::kFunction || item.names[0] != name) continue;
      sizes_[name] = 1;  // overloads call one another at most
      for (std::size_t i = item.body; i < item.end; ++i) size += isName(i) && is(i + 1, "(") ? inlined(tokens_[i].text) : 1;
    }
    return sizes_[name] = size;
  }

  void refuse(std::size_t i, const std::string& what) { wrong_.push_back(at(file_, tokens_[std::min(i, tokens_.size() - 1)].line) + what); }

  void put(std::size_t i, std::string_view text) {
    if (line_ != tokens_[i].line) {
      line_ = tokens_[i].line;
      out_.text.append("\n#line ").append(std::to_string(line_)).append(" \"").append(kPersonsFile).append("\"\n");
    }
    out_.text.append(text).append(" ");
    ++emitted_;
  }

  // (in float a, out vec2 b[3]) without its closing mark.
  void parameters(const TopLevel& f) {
    put(f.parameters, "(");
    std::size_t i = f.parameters + 1;
    for (const std::size_t end : elements(f.parameters, closing(tokens_, f.parameters))) {
      bool byReference = false;
      for (; is(i, "in") || is(i, "out") || is(i, "inout") || is(i, "const") || isPrecision(tokens_[i].text); ++i)
        byReference |= is(i, "out") || is(i, "inout");
      if (!is(i, "void")) {
        const std::size_t own = is(i + 1, "[") ? i + 1 : 0, name = own ? closing(tokens_, own) + 1 : i + 1;
        type(i, is(name + 1, "[") ? name + 1 : own);
        if (byReference) put(i, "&");
        if (name < end) put(name, declare(i, name, renamed(tokens_[name].text)));
      }
      if (!is(end, ")")) put(end, ",");
      i = end + 1;
    }
  }

  // A type; as an array with the size at `open`, if that is not 0.
  void type(std::size_t i, std::size_t open) {
    const std::string name = renamed(tokens_[i].text);
    const std::size_t close = open ? closing(tokens_, open) : 0;
    if (open == 0) return put(i, name);
    if (close == open + 1) return put(i, "auto");  // float a[] = float[](...)
    put(i, "Array__<" + name + ",(");
    emit(open + 1, close);
    put(i, ")>");
  }

  // At a type before a name or a size. Returns the index of the next token.
  std::size_t typed(std::size_t i, std::size_t end, bool isConst) {
    const std::size_t own = is(i + 1, "[") ? i + 1 : 0, name = own ? closing(tokens_, own) + 1 : i + 1;
    if (own && is(name, "(")) return array(i, own, name);
    if (isName(name) && name < end && !is(name + 1, "(")) return declarations(i, own, name, end, isConst);
    type(i, own);  // that a function returns
    return name;
  }

  // float[2](a, b)
  std::size_t array(std::size_t i, std::size_t own, std::size_t open) {
    const std::size_t last = closing(tokens_, open);
    if (closing(tokens_, own) == own + 1)
      put(i, "Array__<" + renamed(tokens_[i].text) + "," + std::to_string(elements(open, last).size()) + ">");
    else
      type(i, own);
    put(i, "{");
    emit(open + 1, last);
    put(i, "}");
    return last + 1;
  }

  // float a[3], b = 2.0, c[2]: each in a declaration of its own, and by another name where its own initialiser speaks of what had the name
  // before: in GLSL its scope begins after that. Returns the index of the token behind.
  std::size_t declarations(std::size_t i, std::size_t own, std::size_t name, std::size_t end, bool isConst, bool ofStruct = false) {
    for (;;) {
      const std::size_t size = is(name + 1, "[") ? name + 1 : own, after = is(name + 1, "[") ? closing(tokens_, name + 1) + 1 : name + 1;
      std::size_t stop = after;
      while (stop < end && !is(stop, ",") && !is(stop, ";")) stop = is(stop, "(") || is(stop, "[") ? closing(tokens_, stop) + 1 : stop + 1;
      bool speaksOfIt = false;
      for (std::size_t k = name + 1; k < stop; ++k) speaksOfIt |= is(k, tokens_[name].text) && !is(k - 1, ".");
      std::string called = renamed(tokens_[name].text);
      if (speaksOfIt && !ofStruct) called += "__" + std::to_string(++renamings_);
      const bool isApart =
          scopes_.back().isSwitch && stop > after && !(size && closing(tokens_, size) == size + 1);  // no case may jump over it
      if (isConst && !isApart) put(i, "const");
      type(i, size);
      put(name, called);
      if (isApart) put(name, "; " + called);
      emit(after, stop);
      if (!ofStruct) declare(i, name, called);
      if (stop >= end || !is(stop, ",")) return stop;
      put(stop, ";");
      name = stop + 1;
    }
  }

  // struct Hill { vec2 at; float w[3], height; }
  std::size_t structure(std::size_t i) {
    const std::size_t close = closing(tokens_, i + 2);
    const std::string name = renamed(tokens_[i + 1].text);
    put(i, "struct " + name + " {");
    for (std::size_t k = i + 3; k < close; ++k) {
      if (isPrecision(tokens_[k].text)) continue;
      const std::size_t own = is(k + 1, "[") ? k + 1 : 0;
      k = declarations(k, own, own ? closing(tokens_, own) + 1 : k + 1, close, false, true);
      put(k, ";");
    }
    put(close, "bool operator==(const " + name + "&) const = default; }");
    return close + 1;
  }

  // A variable of the scope, and how it is called in C++.
  std::string declare(std::size_t type, std::size_t name, std::string called) {
    scopes_.back().types[tokens_[name].text] = tokens_[type].text;
    return scopes_.back().names[tokens_[name].text] = std::move(called);
  }
  bool isLocal(const std::string& name) const {
    return scopes_.size() > 1 && std::any_of(scopes_.begin() + 1, scopes_.end(), [&](const Scope& s) { return s.names.contains(name); });
  }
  std::string called(const std::string& name) const {
    for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope)
      if (const auto found = scope->names.find(name); found != scope->names.end()) return found->second;
    return renamed(name);
  }

  std::string renamed(const std::string& name) const {
    return kClaimed.find(" " + name + " ") != kClaimed.npos ? "claimed__" + name : name;
  }

  // `for (int i = 0; i < 5; ++i)` with constant numbers, and a body that neither changes i nor leaves early.
  std::optional<CountedLoop> counted(std::size_t open, std::size_t close, std::size_t bodyEnd) const {
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

  // An integer literal, or the name of one of the file's integer constants.
  std::optional<long> number(std::size_t i) const {
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

  // Index after the statement that begins at i.
  std::size_t statementEnd(std::size_t i) const {
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

  std::size_t forLoop(std::size_t i) {
    const std::size_t open = i + 1, close = closing(tokens_, open), end = statementEnd(close + 1);
    scopes_.emplace_back();
    if (const auto loop = counted(open, close, end); loop && emitted_ + loop->trips * (end - close) < kMaxTokens) {
      for (std::size_t k = 0; k < loop->trips && emitted_ <= 4 * kMaxTokens; ++k) {
        put(i, (k == 0 ? "{ { const int " : "{ const int ") + declare(open + 1, open + 2, renamed(loop->name)) + " = " +
                   std::to_string(loop->first + static_cast<long>(k)) + ";");
        emit(close + 1, end);
        put(i, "}");
      }
      put(i, loop->trips == 0 ? "{}" : "}");
    } else {
      std::size_t first = open + 1;
      while (first < close && !is(first, ";")) ++first;
      std::size_t second = first + 1;
      while (second < close && !is(second, ";")) ++second;
      const bool declares = isDeclaration(first + 1);
      put(i, "{");
      emit(open + 1, first);
      put(i, "; for (;");
      if (!declares) condition(i, first + 1, second);
      put(i, ";");
      emit(second + 1, close);
      put(i, ")");
      if (declares)
        declaredCondition(first + 1, second, close + 1, end);
      else
        emit(close + 1, end);
      put(i, "}");
    }
    scopes_.pop_back();
    return end;
  }

  void condition(std::size_t at, std::size_t begin, std::size_t end) {
    out_.bounded = true;
    put(at, "(");
    if (begin < end)
      emit(begin, end);
    else
      put(at, "true");
    put(at, ") && --stepsLeft__ >= 0");
  }

  bool isDeclaration(std::size_t i) const { return isType(i) && isName(i + 1); }

  // while (bool more = n < 5): the variable is the body's, made anew each time, and where it is false the loop ends.
  void declaredCondition(std::size_t begin, std::size_t end, std::size_t body, std::size_t bodyEnd) {
    out_.bounded = true;
    scopes_.emplace_back();
    put(begin, "{");
    emit(begin, end);
    put(begin, "; if (!" + called(tokens_[begin + 1].text) + " || --stepsLeft__ < 0) break;");
    emit(body, bodyEnd);
    put(begin, "}");
    scopes_.pop_back();
  }

  void emit(std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end && emitted_ <= 4 * kMaxTokens; ++i) {
      const Token& t = tokens_[i];
      if (t.kind == Kind::kNumber) {
        const bool whole = t.text.find_first_of(".eE") == std::string::npos || t.text.starts_with("0x") || t.text.starts_with("0X");
        if (whole && !t.text.ends_with('u') && !t.text.ends_with('U') && std::strtoull(t.text.c_str(), nullptr, 0) > 0x7fffffff)
          put(i, "int(" + t.text + "u)");  // its bits
        else
          put(i, whole || t.text.ends_with('f') || t.text.ends_with('F') ? t.text : t.text + "f");
      } else if (t.kind == Kind::kMark) {
        i = mark(i);
      } else if (isPrecision(t.text)) {
        continue;
      } else if (t.text == "precision") {
        while (i < end && !is(i, ";")) ++i;
      } else if (t.text == "for") {
        i = forLoop(i) - 1;
      } else if (t.text == "while") {
        const std::size_t close = closing(tokens_, i + 1);
        if (isDeclaration(i + 2)) {
          const std::size_t after = statementEnd(close + 1);
          put(i, "for (;;)");
          declaredCondition(i + 2, close, close + 1, after);
          i = after - 1;
        } else {
          put(i, "while (");
          condition(i, i + 2, close);
          put(i, ")");
          i = close;
        }
      } else if (t.text == "struct") {
        i = structure(i) - 1;
      } else if (t.text == "const" && (isType(i + 1) || isPrecision(tokens_[std::min(i + 1, end - 1)].text))) {
        while (isPrecision(tokens_[i + 1].text)) ++i;
        i = typed(i + 1, end, true) - 1;
      } else if (t.text == "switch") {
        switch_ = closing(tokens_, i + 1) + 1;
        put(i, t.text);
      } else if (t.text == "discard" || t.text.starts_with("gl_") || isOfPictures(i)) {
        refuse(i, "'" + t.text + "' belongs to pictures: a height depends on its arguments alone");
      } else if (std::ranges::find(kOblong, t.text) != kOblong.end()) {
        refuse(i, "heights have square matrices only, no '" + t.text + "'; write it with vectors");
      } else if (isType(i) && i + 1 < end && !is(i + 1, "(")) {
        i = typed(i, end, false) - 1;
      } else {
        if (is(i + 1, "(")) hand(i);
        put(i, called(t.text));
      }
    }
  }

  bool isOfPictures(std::size_t i) const {
    return is(i + 1, "(") && !functions_.contains(tokens_[i].text) &&
           std::ranges::any_of(kOfPictures, [&](std::string_view name) { return tokens_[i].text.starts_with(name); });
  }

  // Whether a statement begins here.
  bool isStatement(std::size_t i) const {
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

  // Several components that a call writes: the function has a copy of them, which goes back at the end of the statement.
  void hand(std::size_t call) {
    const auto [first, last] = written_.equal_range(tokens_[call].text);
    if (first == last) return;
    const std::size_t close = closing(tokens_, call + 1);
    const std::vector<std::size_t> ends = elements(call + 1, close);
    std::size_t begin = call + 2;
    for (std::size_t k = 0; k < ends.size(); begin = ends[k++] + 1) {
      bool writes = false, reads = false;
      for (auto f = first; f != last; ++f)
        if (f->second.size() == ends.size()) (f->second[k] ? writes : reads) = true;
      if (!writes) continue;
      std::size_t from = begin, to = ends[k];
      for (; is(from, "(") && closing(tokens_, from) + 1 == to; ++from) --to;
      const std::size_t whole = to;
      while (is(to - 1, "]")) to = opening(to - 1);
      if (to < from + 3 || !is(to - 2, ".") || selected(to - 2).size() < 2) continue;
      if (to != whole)
        assigned_.insert(to - 2);  // one of them
      else if (isStatement(call) && is(close + 1, ";"))
        handed_.insert(to - 2);
      else if (!reads)
        refuse(to - 2, "where a call's result is used it cannot write several components (." + tokens_[to - 1].text +
                           "); give it a variable of its own");
    }
  }

  // Of `.xz` at a dot, and of `.xyz.xz` as one; empty: it selects no components.
  std::vector<int> selected(std::size_t dot) const {
    if (!isName(dot + 1) || members_.contains(typeBefore(dot))) return {};
    return swizzle(tokens_[dot + 1].text).value_or(std::vector<int>());
  }

  // The struct that the expression before a dot, or an index, is one of, or an array of; otherwise anything else.
  std::string typeBefore(std::size_t end) const {
    if (end == 0) return {};
    if (is(end - 1, "]")) return typeBefore(opening(end - 1));
    if (is(end - 1, ")")) {
      const std::size_t open = opening(end - 1);
      if (open == 0) return {};
      if (is(open - 1, "]")) return tokens_[opening(open - 1) - 1].text;  // Hit[2](a, b)
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
  // Of a function, or of a struct's constructor.
  std::string resultOf(const std::string& name) const {
    if (structs_.contains(name)) return name;
    for (const TopLevel& item : items_)
      if (item.what == TopLevel::What::kFunction && item.names[0] == name)
        for (std::size_t i = item.begin; i < item.parameters; ++i)
          if (structs_.contains(tokens_[i].text)) return tokens_[i].text;
    const auto ofPrelude = preludeFunctions().find(name);
    return ofPrelude == preludeFunctions().end() ? std::string() : ofPrelude->second;
  }

  // Whether the components that are selected up to `after` are assigned to, they or one of them: p.xz *= m, (p.xz)[0] = 1.0.
  bool areAssigned(std::size_t dot, std::size_t after) const {
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
  // Of the bracket that closes here.
  std::size_t opening(std::size_t close) const {
    std::size_t depth = 1;
    while (close > 0 && depth > 0) {
      --close;
      depth += is(close, "]") || is(close, ")") || is(close, "}") ? 1u : 0u;
      depth -= is(close, "[") || is(close, "(") || is(close, "{") ? 1u : 0u;
    }
    return close;
  }

  // Operators and component selection. Returns the index of the last token it consumed.
  std::size_t mark(std::size_t i) {
    const std::string& t = tokens_[i].text;
    const bool literalNext =
        i + 1 < tokens_.size() && tokens_[i + 1].kind == Kind::kNumber && tokens_[i + 1].text.find('.') != std::string::npos;
    if (t == "/" && !literalNext) {
      put(i, "/ over__ /");
    } else if (t == "%") {
      put(i, "/ rem__ /");
    } else if (t == "/=") {
      put(i, literalNext ? "/=" : "/= overAssigned__ =");
    } else if (t == "%=") {
      put(i, "/= remAssigned__ =");
    } else if (t == "^^") {
      refuse(i, "the operator ^^ is not available for heights; for two bools a ^^ b is a != b");
    } else if (t == ".") {
      return selection(i);
    } else if (t == "{") {
      scopes_.emplace_back().isSwitch = i == switch_;
      put(i, t);
    } else if (t == "}") {
      scopes_.pop_back();
      put(i, t);
    } else {
      put(i, t);
    }
    return i;
  }

  std::size_t selection(std::size_t dot) {
    std::vector<int> parts = selected(dot);
    if (parts.empty()) {
      put(dot, isName(dot + 1) ? "." + renamed(tokens_[dot + 1].text) : ".");  // a member
      return isName(dot + 1) ? dot + 1 : dot;
    }
    std::size_t last = dot + 1;
    bool isHanded = handed_.contains(dot), isAssigned = assigned_.contains(dot);
    for (std::vector<int> next; parts.size() > 1 && is(last + 1, ".") && !(next = selected(last + 1)).empty(); last += 2) {
      isHanded |= handed_.contains(last + 1);
      isAssigned |= assigned_.contains(last + 1);
      std::vector<int> both;
      for (const int k : next) both.push_back(parts[std::min(static_cast<std::size_t>(k), parts.size() - 1)]);
      parts = std::move(both);
    }
    if (parts.size() == 1) {
      put(dot, std::string(".") + "xyzw"[parts[0]]);
      return last;
    }
    std::string text = isHanded ? ".handed<" : isAssigned || areAssigned(dot, last + 1) ? ".assigned<" : ".swizzle<";
    for (const int k : parts) text.append(text.ends_with('<') ? "" : ",").append(std::to_string(k));
    put(dot, text + ">()");
    return last;
  }

  std::string_view file_;
  const std::vector<Token>& tokens_;
  const std::vector<TopLevel>& items_;
  std::set<std::string> structs_{"Place", "Corners"}, wanted_, functions_;
  std::map<std::string, std::map<std::string, std::string>> members_{{"Place", {}}, {"Corners", {}}};  // of structs, and their types
  std::multimap<std::string, std::vector<bool>> written_{{"modf", {false, true}}};                     // of each overload
  std::set<std::size_t> handed_, assigned_;                                                            // dots
  struct Scope {
    std::map<std::string, std::string> names, types;  // of variables: in C++; without sizes
    bool isSwitch = false;
  };
  std::vector<Scope> scopes_;
  std::size_t renamings_ = 0, switch_ = 0;
  std::map<std::string, double> sizes_;
  Translation out_;
  std::size_t line_ = 0, emitted_ = 0;
  std::vector<std::string> wrong_;
};

}  // namespace

Outcome<Translation> translate(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours) {
  return Translator(file, tokens, items, colours).run();
}

}  // namespace ridgecast::user_terrain
