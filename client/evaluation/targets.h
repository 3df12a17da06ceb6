#pragma once
// Required and measured quality of the pictures: the first table of the report.

#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "client/evaluation/results.h"
#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// `views`: each view.json. A row for each requirement that was measured, with the worst case; no rows if none was.
Table targetsOf(const std::vector<nlohmann::json>& views, const std::vector<FlightResults>& flights);

}  // namespace ridgecast::evaluation
