#pragma once
// `ridgecast-client evaluate`: flies predefined paths over servers of its own and writes what came out as CSV, SVG plots and one HTML page
// that opens without a network.

#include <filesystem>

namespace ridgecast::evaluation {

struct EvaluateOptions {
  std::filesystem::path out;     // a folder, made when missing; what is there already is not flown again
  bool quick = false;            // small pictures, short flights: minutes on a software driver
  std::filesystem::path server;  // the program; empty: ridgecast-server beside this one
};

// Progress goes to stderr, one line a flight. Returns an exit code of fly.h. Resumable: a flight whose summary is there is not repeated.
int evaluate(const EvaluateOptions& options);

}  // namespace ridgecast::evaluation
