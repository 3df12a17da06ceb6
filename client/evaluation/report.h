#pragma once
// What flights and standing cameras gave, for people: each table as CSV, runs.csv with every flight, plots as SVG, and all of it as one
// page, report.html, that opens without a network, and as a document, report.md.

#include <filesystem>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

struct Run {
  std::string name;  // also of its folder
  std::string terrain, metric;
  double threshold = 0;
  unsigned threads = 0;  // 0: as many as there are
  int repeat = 1;
  std::filesystem::path folder;  // with summary.json, iterations.jsonl and pictures, as `fly` leaves them
};

// `views`: folders as ViewMeasurement leaves them. `machine`: what it was measured with. Error: a summary that cannot be read, or a file
// that cannot be written.
Outcome<void> writeReport(const std::vector<Run>& runs, const std::vector<std::filesystem::path>& views,
                          const std::filesystem::path& folder, const std::string& machine);

}  // namespace ridgecast::evaluation
