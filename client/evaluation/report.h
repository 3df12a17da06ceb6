#pragma once
// What a folder of flights says, for people: runs.csv, plots as SVG, and report.html with everything inside.

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

// Error: a summary that cannot be read, or a file that cannot be written.
Outcome<void> writeReport(const std::vector<Run>& runs, const std::filesystem::path& folder, const std::string& machine);

}  // namespace ridgecast::evaluation
