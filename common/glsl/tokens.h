#pragma once
// A terrain file's text as tokens, and its top level as declarations: as much of GLSL's grammar as checking and translating need. The GLSL
// front end has preprocessed and accepted the text.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/text/text.h"

namespace ridgecast::glsl {

enum class Kind { kName, kNumber, kMark };

struct Token {
  Kind kind;
  std::string text;
  std::size_t line;  // of the user's file, from 1
};

// Directives (lines that begin with #) are skipped. Error: a character that GLSL does not have; begins with "`file`:line: ".
Outcome<std::vector<Token>> tokenise(std::string_view file, std::string_view text);

struct TopLevel {
  enum class What { kFunction, kPrototype, kStruct, kConstant } what;
  std::vector<std::string> names;  // one; constants may have several
  std::size_t line;
  std::size_t begin, end;                // of its tokens
  std::size_t parameters = 0, body = 0;  // functions: index of ( and of {
};

// All its brackets match. Error: they do not, or something that is not allowed at a terrain file's top level, such as a variable or a
// uniform; one line for each (complaints.h).
Outcome<std::vector<TopLevel>> topLevel(std::string_view file, const std::vector<Token>& tokens);

// Index of the mark that closes the one at `open`, or tokens.size().
std::size_t closing(const std::vector<Token>& tokens, std::size_t open);

// "float terrainHeight(ivec2, vec2, float, uint)": only name and types, without precision and parameter names.
std::string signatureOf(const std::vector<Token>& tokens, const TopLevel& function);

bool isPrecision(const std::string& name);  // highp, mediump, lowp
bool isNameCharacter(char c);
std::string at(std::string_view file, std::size_t line);  // "`file`:line: ", as messages begin
using text::trimmed;

}  // namespace ridgecast::glsl
