#pragma once
// Results of flights and cameras at rest, for people: each table as CSV, runs.csv with every flight, plots as SVG, and everything as one
// page, report.html, that needs no network, and as a document, report.md.

#include <filesystem>
#include <string>
#include <vector>

#include "client/evaluation/results.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// `views`: folders as ViewMeasurement leaves them. `machine`: what it was measured with. Error: a summary cannot be read, or a file cannot
// be written.
Outcome<void> writeReport(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views,
                          const std::filesystem::path& folder, const std::string& machine);

}  // namespace ridgecast::evaluation
