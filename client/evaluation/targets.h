#pragma once
// What Ridgecast promises of its pictures, against what came out: the first table of the report.

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "client/evaluation/results.h"
#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// `views`: each view.json. A row for each promise that was measured, by the worst
// of what was; no rows when none was.
Table targetsOf(const std::vector<nlohmann::json>& views, const std::vector<FlightResults>& flights);

}  // namespace ridgecast::evaluation
