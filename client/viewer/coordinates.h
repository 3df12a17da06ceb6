#pragma once
// Metres as typed by a person.

#include <string>
#include <string_view>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::viewer {

// Metres, whole, with a fraction or an exponent ("-4398046511104", "12.5", "1e12"), to the nearest step; exact at any distance. Allows
// surrounding spaces, a plus and thin separators (_ and ') between digits. Errors say what would be right.
Outcome<lattice::Step> parseMetres(std::string_view text);
// Whole metres if possible, otherwise with the fewest digits that tell it from the next step.
std::string formatMetres(lattice::Step steps);

}  // namespace ridgecast::viewer
