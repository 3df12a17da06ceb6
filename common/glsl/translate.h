#pragma once
// From checked GLSL to C++ that follows glsl_as_cpp.h, glsl_extras.h and prelude.glsl: the parts of the file that terrainHeight and
// terrainMaterial need, and terrainColor if possible (otherwise colours stay GLSL). Rewrites swizzles, `out`, arrays, literals and
// division. Unrolls small counted loops, so that the loop over points becomes vector code. All other loops count down kMaxSteps steps a
// point and then end.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/glsl/tokens.h"

namespace ridgecast::glsl {

inline constexpr int kMaxSteps = 10'000;                  // of loops, for one height
inline constexpr std::uint32_t kOutOfSteps = 0x7fc0dead;  // the bits of the NaN that replaces such a height

struct Translation {
  std::string text;      // with #line directives that name kPersonsFile
  bool bounded = false;  // whether it has loops that count steps
  bool colours = false;  // terrainColor is there too
  bool materials = false;
  bool traced = false;  // compile so that Library::trace() can tell where a height went wrong; many times slower
};

inline constexpr std::string_view kPersonsFile = "terrain.glsl";

// Error: something that heights do not support, such as derivatives; one line for each (complaints.h).
Outcome<Translation> translate(std::string_view file, const std::vector<Token>& tokens, const std::vector<TopLevel>& items,
                               bool colours = false);

}  // namespace ridgecast::glsl
