#include "common/glsl/check.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <optional>

#include "common/glsl/complaints.h"
#include "common/process/child.h"
#include "common/process/scratch.h"
#include "common/terrain/terrain.h"

namespace ridgecast::glsl {
namespace {

constexpr std::string_view kHeight = "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed)";
constexpr std::string_view kColour = "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed)";
constexpr std::string_view kMaterial = "int terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, uint seed)";

std::size_t lineOf(std::string_view text, std::size_t position) {
  return static_cast<std::size_t>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(position), '\n')) + 1;
}

// The first byte that is not valid UTF-8 (RFC 3629), if any.
std::optional<std::size_t> notUtf8(std::string_view s) {
  for (std::size_t i = 0; i < s.size();) {
    const auto byte = [&](std::size_t k) { return k < s.size() ? static_cast<unsigned char>(s[k]) : 0u; };
    const unsigned c = byte(i);
    const std::size_t more = c < 0x80 ? 0 : c >= 0xc2 && c < 0xe0 ? 1 : c >= 0xe0 && c < 0xf0 ? 2 : c >= 0xf0 && c < 0xf5 ? 3 : 4;
    if (more == 4 || c == 0) return i;
    for (std::size_t k = 1; k <= more; ++k)
      if ((byte(i + k) & 0xc0) != 0x80) return i;
    const unsigned second = byte(i + 1);
    if ((c == 0xe0 && second < 0xa0) || (c == 0xed && second > 0x9f) || (c == 0xf0 && second < 0x90) || (c == 0xf4 && second > 0x8f))
      return i;
    i += more + 1;
  }
  return std::nullopt;
}

// What is wrong with a line that begins with #.
std::optional<std::string> wrongDirective(std::string_view line) {
  line.remove_prefix(std::min(line.find_first_not_of(" \t", 1), line.size()));
  const std::string word(line.substr(0, static_cast<std::size_t>(std::ranges::find_if_not(line, isNameCharacter) - line.begin())));
  constexpr std::array<std::string_view, 10> kFine = {"define", "undef", "if", "ifdef", "ifndef", "else", "elif", "endif", "error", ""};
  if (std::ranges::find(kFine, word) != kFine.end()) {
    if (line.find("##") != std::string_view::npos) return "## is not GLSL that every client understands";
    return std::nullopt;
  }
  if (word == "include") return "#include is not available: one file is the whole terrain";
  if (word == "version") return "leave #version out: the program puts its own before the file";
  return "#" + word + " is not available in a terrain file";
}

constexpr std::string_view kDesktop = "#version 330 core\n", kEs = "#version 300 es\nprecision highp float;\nprecision highp int;\n";
constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kDialects{
    {{kDesktop, ""}, {kEs, "GLSL ES 3.00, which browsers speak"}}};

struct Assembled {
  std::string_view version;  // version lines of the text
  bool whole = false;        // with a main that calls both functions
};

std::string assembled(const Assembled& how, std::string_view text) {
  std::string out(how.version);
  out.append("#line 1 0\n").append(terrain::prelude()).append("\n#line 1 1\n").append(text).append("\n#line 1 2\n");
  if (how.whole) out.append(terrain::shading()).append("\n");
  out.append("out vec4 colour;\nvoid main() {\n  colour = vec4(");
  out.append(how.whole ? "shadeTerrain(ivec2(1, 2), gl_FragCoord.xy * 0.001, 0.1, vec3(0.0, 0.0, 1.0), 1.0, 2.0, 3u), 1.0" : "1.0");
  return out.append(");\n}\n");
}

// Runs the front end over a text and returns its output.
Outcome<process::ChildEnd> glslang(const process::Scratch& scratch, const std::filesystem::path& program,
                                   std::vector<std::string> arguments, const std::string& text, const std::stop_token& stop) {
  const std::filesystem::path file = scratch.path() / "terrain.frag";
  std::ofstream(file, std::ios::binary) << text;
  arguments.push_back(file.string());
  auto end = process::runChild(program, arguments, {.time = std::chrono::seconds(20)}, stop);
  if (end && (end->timedOut || end->status < 0)) return Error{"the GLSL front end needed too much time or memory; make the file smaller"};
  return end;
}

// The front end's errors: "ERROR: 1:12: 'x' : undeclared identifier" -> "file:12: 'x' : undeclared identifier".
std::vector<std::string> complaintsOf(std::string_view file, std::string_view output, std::string_view dialect) {
  const std::string tail = dialect.empty() ? "" : " (as " + std::string(dialect) + ")";
  std::vector<std::string> out;
  std::string elsewhere;
  for (std::size_t begin = output.find("ERROR: "); begin != std::string_view::npos; begin = output.find("ERROR: ", begin + 1)) {
    std::string_view line = output.substr(begin + 7, output.find('\n', begin) - begin - 7);
    std::size_t source = 0, number = 0;
    const auto first = std::from_chars(line.data(), line.data() + line.size(), source);
    if (first.ec != std::errc() || *first.ptr != ':') continue;
    const auto second = std::from_chars(first.ptr + 1, line.data() + line.size(), number);
    if (second.ec != std::errc() || *second.ptr != ':') continue;
    std::string_view what = line.substr(static_cast<std::size_t>(second.ptr + 1 - line.data()));
    what = trimmed(what);
    for (const std::string_view nothing : {"'' : ", "'' :"})
      if (what.starts_with(nothing)) what = trimmed(what.substr(nothing.size()));
    if (what.starts_with("compilation terminated")) continue;
    if (source == 1)
      out.push_back(at(file, number) + std::string(what) + tail);
    else if (elsewhere.empty())
      elsewhere = std::string(file) + ": does not go together with the program's own GLSL: " + std::string(what) + tail;
  }
  if (!out.empty()) return out;
  if (elsewhere.empty())
    elsewhere = std::string(file) + ": the GLSL front end refuses it: " + std::string(trimmed(output.substr(0, 300))) + tail;
  return {elsewhere};
}

// Everything that is wrong with the text as GLSL 3.30 and, on other lines, as GLSL ES 3.00; empty: nothing. The front end goes on after an
// error only at the risk of a crash; then its first one must do.
Outcome<std::vector<std::string>> syntaxErrors(std::string_view file, std::string_view text, const process::Scratch& scratch,
                                               const std::filesystem::path& program, const std::stop_token& stop) {
  std::vector<std::string> out;
  for (const auto& [version, dialect] : kDialects) {
    auto end = glslang(scratch, program, {}, assembled({version}, text), stop);
    if (!end) return end.error();
    if (end->status == 0) continue;
    if (const auto all = glslang(scratch, program, {"-C"}, assembled({version}, text), stop);
        all && all->output.find("ERROR: 1:") != std::string::npos)
      *end = *all;
    const std::vector<std::string> before = out;
    for (std::string& complaint : complaintsOf(file, end->output, dialect)) {
      const std::string place = complaint.substr(0, complaint.find(' ') + 1);
      if (std::ranges::none_of(before, [&](const std::string& b) { return b.starts_with(place); })) out.push_back(std::move(complaint));
    }
  }
  return out;
}

Outcome<void> checkSignature(std::string_view file, const Checked& c, std::string_view name, std::string_view wanted,
                             std::string_view bare) {
  const TopLevel* found = nullptr;
  for (const TopLevel& item : c.items) {
    if (item.what != TopLevel::What::kFunction || item.names[0] != name) continue;
    if (signatureOf(c.tokens, item) == bare) return {};
    found = &item;
  }
  if (found)
    return Error{at(file, found->line) + "the signature of " + std::string(name) + " is " + signatureOf(c.tokens, *found) +
                 "; it must be " + std::string(wanted)};
  return Error{std::string(file) + ": there is no function " + std::string(name) + "; it must have: " + std::string(wanted)};
}

}  // namespace

Outcome<void> checkText(std::string_view file, std::string_view text) {
  if (text.size() > kMaxText)
    return Error{std::string(file) + ": the file has " + std::to_string(text.size()) + " bytes; a terrain file has at most " +
                 std::to_string(kMaxText)};
  if (const auto wrong = notUtf8(text)) return Error{at(file, lineOf(text, *wrong)) + "this is not UTF-8 text; save the file as UTF-8"};
  const std::string code = withoutComments(text);
  std::vector<std::string> wrong;
  std::size_t line = 0;
  const auto refuse = [&](const std::string& what) { wrong.push_back(at(file, line) + what); };
  for (std::size_t begin = 0; begin < code.size();) {
    const std::size_t end = std::min(code.find('\n', begin), code.size());
    const std::string_view s = std::string_view(code).substr(begin, end - begin);
    begin = end + 1;
    ++line;
    const std::size_t first = s.find_first_not_of(" \t");
    if (first == std::string_view::npos) continue;
    const std::size_t before = wrong.size();
    if (s[first] == '#')
      if (const auto directive = wrongDirective(s.substr(first))) refuse(*directive);
    if (s.find('\\') != std::string_view::npos)
      refuse("a backslash is the last of its line, which goes on in the next, and has no blank behind it");
    for (std::size_t i = 0; i < s.size();) {
      if (!isNameCharacter(s[i])) {
        ++i;
        continue;
      }
      std::size_t stop = i;
      while (stop < s.size() && isNameCharacter(s[stop])) ++stop;
      const std::string_view word = s.substr(i, stop - i);
      if (word == "asm" || word == "__asm__" || word == "__asm") refuse("inline assembler is not available in a terrain file");
      if (word.find("__") != std::string_view::npos)
        refuse(std::string(word.substr(0, 64)) + ": GLSL keeps names with two underscores to itself");
      i = stop;
    }
    if (wrong.size() == before && s.find_first_of("\"'") != std::string_view::npos) refuse("GLSL has no text in quotation marks");
  }
  if (!wrong.empty()) return joined(file, std::move(wrong));
  return {};
}

Outcome<Checked> checkGlsl(std::string_view file, std::string_view text, const std::stop_token& stop) {
  const auto program = process::findProgram("glslangValidator");
  if (!program)
    return Error{"glslangValidator, which checks terrain files, is not installed; on Debian: apt-get install glslang-tools g++"};
  auto scratch = process::Scratch::create();
  if (!scratch) return scratch.error();
  auto wrong = syntaxErrors(file, text, *scratch, *program, stop);
  if (!wrong) return wrong.error();
  if (!wrong->empty()) return joined(file, std::move(*wrong));

  auto end = glslang(*scratch, *program, {"-E"}, std::string(kDesktop) + "#line 1 1\n" + std::string(text) + "\n", stop);
  if (!end) return end.error();
  const std::size_t marker = end->output.find("#line 1 1\n");
  // The child's output is cut at its limit. Longer output comes from macros.
  if (end->status != 0 || marker == std::string::npos || end->output.size() >= process::kMaxOutput)
    return Error{std::string(file) + ": too long once its macros are expanded; write functions instead"};
  Checked out;
  auto tokens = tokenise(file, std::string_view(end->output).substr(marker + 10));
  if (!tokens) return tokens.error();
  out.tokens = std::move(*tokens);
  auto items = topLevel(file, out.tokens);
  if (!items) return items.error();
  out.items = std::move(*items);
  if (auto right = checkSignature(file, out, "terrainHeight", kHeight, "float terrainHeight(ivec2, vec2, float, uint)"); !right)
    wrong->push_back(right.error().message);
  if (auto right = checkSignature(file, out, "terrainColor", kColour, "vec3 terrainColor(ivec2, vec2, float, vec3, float, uint)"); !right)
    wrong->push_back(right.error().message);
  if (out.hasMaterials())
    if (auto right = checkSignature(file, out, "terrainMaterial", kMaterial, "int terrainMaterial(ivec2, vec2, float, vec3, uint)"); !right)
      wrong->push_back(right.error().message);
  if (!wrong->empty()) return joined(file, std::move(*wrong));

  for (const auto& [version, dialect] : kDialects) {
    end = glslang(*scratch, *program, {"-l"}, assembled({version, true}, text), stop);
    if (!end) return end.error();
    if (end->status == 0) continue;
    if (const auto recursion = end->output.find("Recursion detected:"); recursion != std::string::npos) {
      std::string_view rest = std::string_view(end->output).substr(std::min(end->output.find('\n', recursion) + 1, end->output.size()));
      rest = trimmed(rest.substr(0, rest.find('(')));
      for (const TopLevel& item : out.items)
        if (item.names[0] == rest)
          return Error{at(file, item.line) + "recursion: " + std::string(rest) +
                       " calls itself, perhaps through others; GLSL has no recursion"};
      return Error{std::string(file) + ": recursion: GLSL has none"};
    }
    return joined(file, complaintsOf(file, end->output, dialect));
  }
  return out;
}

}  // namespace ridgecast::glsl
