#pragma once
// What the flights gave, as tables: chapter 4 of the thesis, and what it could not measure.

#include <vector>

#include "client/evaluation/report.h"
#include "client/evaluation/table.h"

namespace ridgecast::evaluation {

// Error: a summary that cannot be read.
Outcome<std::vector<Table>> flightTables(const std::vector<Run>& runs);

}  // namespace ridgecast::evaluation
