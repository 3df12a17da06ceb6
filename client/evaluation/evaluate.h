#pragma once
// `ridgecast-client evaluate`: stands and flies over predefined ground with servers of its own and writes what came out as CSV, SVG plots,
// one HTML page that opens without a network, and a document of the same tables.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/evaluation/views.h"
#include "common/outcome/outcome.h"

namespace ridgecast::evaluation {

// What is left out is what the full evaluation has, or with `quick` the quick one (plan.h).
struct EvaluateOptions {
  std::filesystem::path out;                   // a folder, made when missing; what is there already is not measured again
  bool quick = false;                          // small pictures, short flights: minutes on a software driver
  bool reportOnly = false;                     // measures nothing: reports what is there of it
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

// "METRIC:THRESHOLD", as in "area:0.3". Error: what it is not.
Outcome<MeshCase> meshCaseFrom(std::string_view text);

// Progress goes to stderr, a line for each thing measured. Returns an exit code (exit.h). Resumable: what has its result in the folder is
// not measured again; a folder that was begun with other options is refused (kBadInput).
int evaluate(const EvaluateOptions& options);

}  // namespace ridgecast::evaluation
