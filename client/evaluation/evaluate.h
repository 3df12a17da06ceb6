#pragma once
// `ridgecast-client evaluate`: measures cameras at rest and flights over predefined ground with its own servers. report.py, which
// it leaves there, writes CSV, SVG plots, one HTML page that needs no network, and a document of the same tables.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/evaluation/views.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// Defaults: the full evaluation's, or with `quick` the quick one's (plan.h).
struct EvaluateOptions {
  std::filesystem::path out;                   // a folder, made if missing; existing results are kept
  bool quick = false;                          // small pictures, short flights: minutes on a software driver
  bool reportOnly = false;                     // measures nothing: reports the results so far
  std::filesystem::path server;                // the program; empty: ridgecast-server beside this one
  std::vector<std::string> terrains;           // built-in ones; empty: all
  std::vector<std::string> views;              // low, overview, grazing; empty: all
  std::vector<MeshCase> refined;               // of views and flights alike; the first one is repeated and flown by fewer threads
  std::string only;                            // "views", "flights" or empty: both
  std::optional<std::uint32_t> width, height;  // pixels, both or none
  std::optional<std::uint32_t> supersample;    // 1, 2, 4, ...: views are drawn with 1, 2, ... up to N x N samples a pixel
  std::optional<int> repeats;                  // of what is timed
  std::optional<double> seconds;               // only the beginning of each flight
};

// "METRIC:THRESHOLD", as in "area:0.3".
Outcome<MeshCase> meshCaseFrom(std::string_view text);

// Progress goes to stderr, a line for each part. Returns an exit code (exit.h). Resumable: parts with results in the folder are not
// measured again. Refuses a folder of other options (kBadInput).
int evaluate(const EvaluateOptions& options);

}  // namespace ridgecast::evaluation
