#pragma once
// Results of the flights as tables: chapter 4 of the thesis, and what it could not measure.

#include <vector>

#include "client/evaluation/results.h"
#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

std::vector<Table> flightTables(const std::vector<FlightResults>& flights);

}  // namespace ridgecast::evaluation
