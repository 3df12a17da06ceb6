#pragma once
// Curves along the flights, as SVG.

#include <string>
#include <vector>

#include "client/evaluation/results.h"

namespace ridgecast::evaluation {

struct Plot {
  std::string file, svg;
};

std::vector<Plot> plotsOf(const std::vector<FlightResults>& flights);  // of none: none

}  // namespace ridgecast::evaluation
