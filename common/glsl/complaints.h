#pragma once
// Several errors of a terrain file as one message: a line "`file`:line: what is wrong" for each. Pure; any thread.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::glsl {

inline constexpr std::size_t kMaxComplaints = 20;  // of one message; the others are counted

// By line, each once.
Error joined(std::string_view file, std::vector<std::string> complaints);

// The message with the file's line and a caret below each error, and with the rewrite if an int stands where a float belongs.
std::string explained(std::string_view file, std::string_view text, std::string_view message);

// The text with comments blanked out, line breaks kept.
std::string withoutComments(std::string_view text);

// What compiles but is no good ground, such as fract(sin(...)): a message as explained() makes it; empty: nothing.
std::string advice(std::string_view file, std::string_view text);

}  // namespace ridgecast::glsl
