#include "common/glsl/translate.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <set>

#include "common/glsl/complaints.h"
#include "common/glsl/syntax.h"
#include "common/outcome/contract.h"

namespace ridgecast::glsl {
namespace {

constexpr double kMaxInlined = 300'000;     // words; g++ takes about a minute for this many
constexpr std::size_t kMaxTokens = 60'000;  // of the translation; loops that would exceed it are not unrolled

// Reserved in C++ but not in GLSL, each between spaces.
constexpr std::string_view kClaimed =
    " alignas alignof and and_eq auto bitand bitor catch char char16_t char32_t char8_t co_await co_return co_yield compl "
    "concept const_cast consteval constexpr constinit decltype delete dynamic_cast explicit export friend mutable new "
    "noexcept not not_eq nullptr operator or or_eq private protected register reinterpret_cast requires signed static_assert "
    "static_cast thread_local throw try typeid typename virtual wchar_t xor xor_eq ";

constexpr std::array<std::string_view, 6> kOblong = {"mat2x3", "mat2x4", "mat3x2", "mat3x4", "mat4x2", "mat4x3"};

class Translator : Syntax {
 public:
  Translator(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours)
      : Syntax(tokens, items, colours), file_(file) {
    out_.colours = colours;
    out_.materials = wanted_.contains("terrainMaterial");
  }

  Outcome<Translation> run() {
    for (const std::string name : {"terrainHeight", "terrainColor", "terrainMaterial"})
      if (const double size = wanted_.contains(name) ? inlined(name) : 0; size > kMaxInlined)
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
    expects(scopes_.size() == 1, "each scope that opened has closed");
    out_.text += "\n";
    return std::move(out_);
  }

 private:
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
  std::string called(const std::string& name) const {
    for (auto scope = scopes_.rbegin(); scope != scopes_.rend(); ++scope)
      if (const auto found = scope->names.find(name); found != scope->names.end()) return found->second;
    return renamed(name);
  }

  std::string renamed(const std::string& name) const {
    return kClaimed.find(" " + name + " ") != kClaimed.npos ? "claimed__" + name : name;
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

  // What was translated from `from` on ends before `next`.
  static std::size_t lastBefore(std::size_t next, std::size_t from) {
    expects(next > from, "translation goes forward");
    return next - 1;
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
        i = lastBefore(forLoop(i), i);
      } else if (t.text == "while") {
        const std::size_t close = closing(tokens_, i + 1);
        if (isDeclaration(i + 2)) {
          const std::size_t after = statementEnd(close + 1);
          put(i, "for (;;)");
          declaredCondition(i + 2, close, close + 1, after);
          i = lastBefore(after, i);
        } else {
          put(i, "while (");
          condition(i, i + 2, close);
          put(i, ")");
          i = close;
        }
      } else if (t.text == "struct") {
        i = lastBefore(structure(i), i);
      } else if (t.text == "const" && (isType(i + 1) || isPrecision(tokens_[std::min(i + 1, end - 1)].text))) {
        while (isPrecision(tokens_[i + 1].text)) ++i;
        i = lastBefore(typed(i + 1, end, true), i);
      } else if (t.text == "switch") {
        switch_ = closing(tokens_, i + 1) + 1;
        put(i, t.text);
      } else if (t.text == "discard" || t.text.starts_with("gl_") || isOfPictures(i)) {
        refuse(i, "'" + t.text + "' belongs to pictures: a height depends on its arguments alone");
      } else if (std::ranges::find(kOblong, t.text) != kOblong.end()) {
        refuse(i, "heights have square matrices only, no '" + t.text + "'; write it with vectors");
      } else if (isType(i) && i + 1 < end && !is(i + 1, "(")) {
        i = lastBefore(typed(i, end, false), i);
      } else {
        if (is(i + 1, "(")) hand(i);
        put(i, called(t.text));
      }
    }
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
      expects(scopes_.size() > 1, "brackets match");
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
  std::set<std::size_t> handed_, assigned_;  // dots
  std::size_t renamings_ = 0, switch_ = 0;
  Translation out_;
  std::size_t line_ = 0, emitted_ = 0;
  std::vector<std::string> wrong_;
};

}  // namespace

Outcome<Translation> translate(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items, bool colours) {
  return Translator(file, tokens, items, colours).run();
}

}  // namespace ridgecast::glsl
