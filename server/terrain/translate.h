#pragma once
// From checked GLSL to C++ that glsl_as_cpp.h, glsl_extras.h and prelude.glsl stand before: what terrainHeight needs of the file, and,
// where it can be had so, terrainColor (else colours stay GLSL). Swizzles, `out`, arrays, literals and division are rewritten; small counted loops are written out,
// which lets the loop over points become vector code; all others run down a counter of kMostSteps steps a point, after which they end.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "server/terrain/tokens.h"

namespace ridgecast::user_terrain {

inline constexpr int kMostSteps = 10'000;                 // of loops, for one height
inline constexpr std::uint32_t kOutOfSteps = 0x7fc0dead;  // the bits of what such a height is instead: a NaN of our own

struct Translation {
  std::string text;      // with #line directives that name kPersonsFile
  bool bounded = false;  // whether it has loops that count steps
  bool colours = false;  // terrainColor is there too
};

inline constexpr std::string_view kPersonsFile = "terrain.glsl";

// Error: something that heights cannot have, such as assigning to several components at once; begins with "`file`:line: ".
Outcome<Translation> translate(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items,
                               bool colours = false);

}  // namespace ridgecast::user_terrain
