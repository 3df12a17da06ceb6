#pragma once
// Curves along the flights, as SVG.

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/evaluation/report.h"

namespace ridgecast::evaluation {

struct Plot {
  std::string file, svg;
};

// `summaries`: what summary.json of each run says, in their order.
std::vector<Plot> plotsOf(const std::vector<Run>& runs, const std::vector<nlohmann::json>& summaries);

}  // namespace ridgecast::evaluation
