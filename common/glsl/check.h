#pragma once
// Checks that a user's text is a terrain file: size, encoding, forbidden content, GLSL as every client's compiler accepts it, and its
// functions with their signatures. An error holds all that was found, one line each (complaints.h).

#include <algorithm>
#include <cstddef>
#include <stop_token>
#include <string_view>
#include <vector>

#include "common/glsl/tokens.h"
#include "common/outcome/outcome.h"

namespace ridgecast::glsl {

inline constexpr std::size_t kMaxText = 256 << 10;  // bytes

// The checks that need no compiler.
Outcome<void> checkText(std::string_view file, std::string_view text);

struct Checked {
  std::vector<Token> tokens;  // preprocessed
  std::vector<TopLevel> items;
  bool hasMaterials() const {
    return std::any_of(items.begin(), items.end(),
                       [](const TopLevel& item) { return item.what == TopLevel::What::kFunction && item.names[0] == "terrainMaterial"; });
  }
};

// The GLSL front end's verdict as GLSL 3.30 and as GLSL ES 3.00, then the signatures. Runs glslangValidator in a child process, which
// `stop` ends; it is an error if that is not installed.
Outcome<Checked> checkGlsl(std::string_view file, std::string_view text, const std::stop_token& stop = {});

}  // namespace ridgecast::glsl
