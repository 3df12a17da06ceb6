#include "common/user_terrain/translate.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <set>

#include "common/user_terrain/complaints.h"

namespace ridgecast::user_terrain {
namespace {

constexpr std::size_t kMostTripsWrittenOut = 32;
constexpr double kMostInlined = 300'000;     // words; g++ takes about a minute for this many
constexpr std::size_t kMostTokens = 60'000;  // of the translation; loops that would exceed it are not unrolled

// Reserved in C++ but not in GLSL, each between spaces.
constexpr std::string_view kClaimed =
    " alignas alignof and and_eq auto bitand bitor catch char char16_t char32_t char8_t co_await co_return co_yield compl "
    "concept const_cast consteval constexpr constinit decltype delete dynamic_cast explicit export friend mutable new "
    "noexcept not not_eq nullptr operator or or_eq private protected register reinterpret_cast requires signed static_assert "
    "static_cast thread_local throw try typeid typename virtual wchar_t xor ";

constexpr std::array<std::string_view, 22> kTypes = {"float", "int",   "uint",  "bool",   "vec2",   "vec3",  "vec4",  "ivec2",
                                                     "ivec3", "ivec4", "uvec2", "uvec3",  "uvec4",  "bvec2", "bvec3", "bvec4",
                                                     "mat2",  "mat3",  "mat4",  "mat2x2", "mat3x3", "mat4x4"};
// Of what a picture has around a pixel, or a texture.
constexpr std::array<std::string_view, 4> kOfPictures = {"gl_", "dFd", "fwidth", "texture"};
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
      if (const double size = inlined(name); size > kMostInlined && (out_.colours || name == "terrainHeight"))
        return Error{std::string(file_) + ": with all its calls written out " + name + " would be " +
                     std::to_string(static_cast<long long>(std::min(size, 1e15))) + " words long; it calls too much: write it shorter"};
    for (const TopLevel& item : items_) {
      if (std::ranges::none_of(item.names, [&](const std::string& n) { return wanted_.contains(n); })) continue;
      if (item.what == TopLevel::What::kStruct) {
        const std::size_t close = item.end - 2;
        emit(item.begin, close);
        put(close, "bool operator==(const " + renamed(item.names[0]) + "&) const = default;");
        emit(close, item.end);
      } else if (item.what == TopLevel::What::kFunction || item.what == TopLevel::What::kPrototype) {
        emit(item.begin, item.parameters);
        parameters(item);
        emit(closing(tokens_, item.parameters), item.end);
      } else {
        emit(item.begin, item.end);
      }
    }
    if (!wrong_.empty()) return joined(file_, std::move(wrong_));
    if (emitted_ > 4 * kMostTokens) return Error{std::string(file_) + ": this is too much for one terrain: write it shorter"};
    out_.text += "\n";
    return std::move(out_);
  }

 private:
  bool is(std::size_t i, std::string_view text) const { return i < tokens_.size() && tokens_[i].text == text; }
  bool isName(std::size_t i) const { return i < tokens_.size() && tokens_[i].kind == Kind::kName; }
  bool isType(std::size_t i) const {
    return isName(i) && (std::ranges::find(kTypes, tokens_[i].text) != kTypes.end() || structs_.contains(tokens_[i].text));
  }

  // Names of structs and members, and everything that terrainHeight reaches.
  void collect() {
    for (const TopLevel& item : items_) {
      if (item.what != TopLevel::What::kStruct) continue;
      structs_.insert(item.names[0]);
      for (std::size_t i = item.begin + 3; i < item.end; ++i)
        if (isName(i) && (is(i + 1, ";") || is(i + 1, ",") || is(i + 1, "["))) members_.insert(tokens_[i].text);
    }
    for (const TopLevel& item : items_)
      if (item.what == TopLevel::What::kFunction) writes(item);
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

  // Which arguments functions of this name write.
  void writes(const TopLevel& f) {
    std::vector<bool>& written = written_[f.names[0]];
    std::size_t begin = f.parameters + 1, k = 0;
    for (const std::size_t end : elements(f.parameters, closing(tokens_, f.parameters))) {
      written.resize(std::max(written.size(), k + 1));
      for (std::size_t i = begin; i < end; ++i)
        if (is(i, "out") || is(i, "inout")) written[k] = true;
      begin = end + 1, ++k;
    }
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
    const std::size_t close = closing(tokens_, f.parameters);
    put(f.parameters, "(");
    for (std::size_t i = f.parameters + 1; i < close; ++i) {
      bool byReference = false;
      for (; i < close && (is(i, "in") || is(i, "out") || is(i, "inout") || is(i, "const") || isPrecision(tokens_[i].text)); ++i)
        byReference |= is(i, "out") || is(i, "inout");
      if (is(i, "void")) continue;
      std::size_t end = i;
      while (end < close && !is(end, ",")) ++end;
      i = declared(i, byReference);
      if (i < end) emit(i, end);
      if (end < close) put(end, ",");
      i = end;
    }
  }

  // At a type: writes it, arrays as Array__<type, size>, with the name if one follows. Returns the index of the next token.
  std::size_t declared(std::size_t i, bool byReference) {
    std::size_t name = i + 1, open = i + 1;
    if (is(open, "["))
      name = closing(tokens_, open) + 1;
    else if (isName(name) && is(name + 1, "["))
      open = name + 1;
    if (!is(open, "[") || !isType(i)) {
      put(i, renamed(tokens_[i].text));
      if (byReference) put(i, "&");
      return i + 1;
    }
    const std::size_t close = closing(tokens_, open);
    std::size_t after = std::max(name + 1, close + 1);
    const bool isConstructor = name < tokens_.size() && is(name, "(");
    if (isConstructor) {  // float[2](a, b)
      const std::size_t last = closing(tokens_, name);
      put(i, "Array__<" + tokens_[i].text + ",");
      if (close == open + 1)
        put(i, std::to_string(elements(name, last).size()));
      else
        emit(open + 1, close);
      put(i, ">{");
      emit(name + 1, last);
      put(i, "}");
      return last + 1;
    }
    if (close == open + 1) {  // float a[] = float[](...)
      put(i, "auto");
    } else {
      put(i, "Array__<" + tokens_[i].text + ",");
      emit(open + 1, close);
      put(i, ">");
    }
    if (byReference) put(i, "&");
    if (isName(name)) put(name, renamed(tokens_[name].text));
    return after;
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
    if (!steps || trips > static_cast<long>(kMostTripsWrittenOut)) return std::nullopt;
    for (std::size_t k = close + 1; k < bodyEnd; ++k) {
      if (is(k, "break") || is(k, "continue")) return std::nullopt;
      if (is(k, loop.name) && ((k + 1 < bodyEnd && isAssignment(tokens_[k + 1].text)) || is(k - 1, "++") || is(k - 1, "--")))
        return std::nullopt;
    }
    loop.first = *first;
    loop.trips = static_cast<std::size_t>(std::max(trips, 0l));
    return loop;
  }

  // An integer literal, or the name of one of the file's integer constants.
  std::optional<long> number(std::size_t i) const {
    if (i >= tokens_.size()) return std::nullopt;
    if (tokens_[i].kind == Kind::kName) {
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
    if (const auto loop = counted(open, close, end); loop && emitted_ + loop->trips * (end - close) < kMostTokens) {
      put(i, "{");
      for (std::size_t k = 0; k < loop->trips && emitted_ <= 4 * kMostTokens; ++k) {
        put(i, "{ const int " + renamed(loop->name) + " = " + std::to_string(loop->first + static_cast<long>(k)) + ";");
        emit(close + 1, end);
        put(i, "}");
      }
      put(i, "}");
      return end;
    }
    std::size_t first = open + 1;
    while (first < close && !is(first, ";")) ++first;
    std::size_t second = first + 1;
    while (second < close && !is(second, ";")) ++second;
    put(i, "for (");
    emit(open + 1, first);
    put(i, ";");
    condition(i, first + 1, second);
    put(i, ";");
    emit(second + 1, close);
    put(i, ")");
    return close + 1;
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

  void emit(std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end && emitted_ <= 4 * kMostTokens; ++i) {
      const Token& t = tokens_[i];
      if (t.kind == Kind::kNumber) {
        const bool whole = t.text.find_first_of(".eE") == std::string::npos || t.text.starts_with("0x") || t.text.starts_with("0X");
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
        put(i, "while (");
        condition(i, i + 2, close);
        put(i, ")");
        i = close;
      } else if (t.text == "discard" || std::ranges::any_of(kOfPictures, [&](auto name) { return t.text.starts_with(name); })) {
        refuse(i, "'" + t.text + "' belongs to pictures: a height depends on its arguments alone");
      } else if (std::ranges::find(kOblong, t.text) != kOblong.end()) {
        refuse(i, "heights have square matrices only, no '" + t.text + "'; write it with vectors");
      } else if (isType(i) && i + 1 < end && !is(i + 1, "(")) {
        i = declared(i, false) - 1;
      } else {
        if (is(i + 1, "(")) hand(i);
        put(i, renamed(t.text));
      }
    }
  }

  // Several components that a call writes: the function has a copy of them, which goes back at the end of the statement.
  void hand(std::size_t call) {
    const auto written = written_.find(tokens_[call].text);
    if (written == written_.end()) return;
    const std::size_t close = closing(tokens_, call + 1);
    const bool isStatement = call > 0 &&
                             (is(call - 1, ";") || is(call - 1, "{") || is(call - 1, "}") || is(call - 1, ")") || is(call - 1, "else")) &&
                             is(close + 1, ";");
    std::size_t k = 0;
    for (const std::size_t end : elements(call + 1, close)) {
      if (k < written->second.size() && written->second[k] && is(end - 2, ".") && selected(end - 2).size() > 1) {
        handed_.insert(end - 2);
        if (!isStatement)
          refuse(end - 2, "where a call's result is used it cannot write several components (." + tokens_[end - 1].text +
                              "); give it a variable of its own");
      }
      ++k;
    }
  }

  // Of `.xz` at a dot, and of `.xyz.xz` as one; empty: it selects no components.
  std::vector<int> selected(std::size_t dot) const {
    if (!isName(dot + 1) || members_.contains(tokens_[dot + 1].text)) return {};
    return swizzle(tokens_[dot + 1].text).value_or(std::vector<int>());
  }

  // Whether the components that are selected up to `after` are assigned to, they or one of them: p.xz *= m, p.xz[0] = 1.0.
  bool areAssigned(std::size_t dot, std::size_t after) const {
    while (is(after, "[")) after = closing(tokens_, after) + 1;
    if (after < tokens_.size() && isAssignment(tokens_[after].text)) return true;
    std::size_t begin = dot;  // of a.b[i].xz
    while (begin > 0 && (isName(begin - 1) || is(begin - 1, ".") || is(begin - 1, "]")))
      begin = is(begin - 1, "]") ? opening(begin - 1) : begin - 1;
    return begin > 0 && (is(begin - 1, "++") || is(begin - 1, "--"));
  }
  std::size_t opening(std::size_t close) const {
    std::size_t depth = 1;
    while (close > 0 && depth > 0) {
      --close;
      depth += is(close, "]") ? 1u : 0u;
      depth -= is(close, "[") ? 1u : 0u;
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
    } else {
      put(i, t);
    }
    return i;
  }

  std::size_t selection(std::size_t dot) {
    std::vector<int> parts = selected(dot);
    if (parts.empty()) {
      put(dot, ".");
      return dot;
    }
    std::size_t last = dot + 1;
    bool isHanded = handed_.contains(dot);
    for (std::vector<int> next; parts.size() > 1 && is(last + 1, ".") && !(next = selected(last + 1)).empty(); last += 2) {
      isHanded |= handed_.contains(last + 1);
      std::vector<int> both;
      for (const int k : next) both.push_back(parts[std::min(static_cast<std::size_t>(k), parts.size() - 1)]);
      parts = std::move(both);
    }
    if (parts.size() == 1) {
      put(dot, std::string(".") + "xyzw"[parts[0]]);
      return last;
    }
    std::string text = isHanded ? ".handed<" : areAssigned(dot, last + 1) ? ".assigned<" : ".swizzle<";
    for (const int k : parts) text.append(text.ends_with('<') ? "" : ",").append(std::to_string(k));
    put(dot, text + ">()");
    return last;
  }

  std::string_view file_;
  const std::vector<Token>& tokens_;
  const std::vector<TopLevel>& items_;
  std::set<std::string> structs_{"Place", "Corners"}, members_{"cell", "at", "slope", "height", "h00", "h10", "h01", "h11"}, wanted_;
  std::map<std::string, std::vector<bool>> written_{{"modf", {false, true}}};
  std::set<std::size_t> handed_;  // dots
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
