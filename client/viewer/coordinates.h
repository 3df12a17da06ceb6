#pragma once
// What a person types where a number of metres is wanted.

#include <string>
#include <string_view>

#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::viewer {

// Metres, whole or with a fraction ("-4398046511104", "12.5"), to the nearest step; exact however far out. Spaces around it, a plus and thin
// separators (_ and ') between digits are allowed. Errors say what would be right.
Outcome<lattice::Step> parseMetres(std::string_view text);
// Whole metres where it is, else with as few digits as tell it from the next step.
std::string formatMetres(lattice::Step steps);

}  // namespace ridgecast::viewer
