#pragma once
// What an evaluation measures, in which order. Only times are repeated: in lock-step a flight's meshes and pictures are the same each time.
// Flights over one terrain come one after the other and are compared with the same ray marches (recorder.h).

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "client/evaluation/evaluate.h"
#include "client/evaluation/results.h"
#include "client/evaluation/views.h"

namespace ridgecast::evaluation {

struct PlannedView {
  ViewCase view;
  std::filesystem::path folder;  // of its results
  double cost = 0;               // seconds, roughly, on two cores without a graphics card
};

struct PlannedFlight {
  Run run;
  double seconds = 0;  // of its path at most; 0: rests at the beginning
  bool pictures = false;
  bool frames = false;   // uploads and draws every iteration
  bool popping = false;  // of a camera at rest while the mesh refines
  double cost = 0;       // seconds, roughly
};

struct Plan {
  bool quick = false;
  std::uint32_t width = 0, height = 0;  // pixels
  int repeats = 1;
  double framesEvery = 0;              // seconds of path time between pictures
  std::vector<std::uint32_t> samples;  // of the views: 1, 2, 4, ...
  std::vector<MeshCase> meshes;        // of the views
  std::vector<PlannedView> views;
  std::vector<PlannedFlight> flights;
  std::string words;  // the options in one line: a folder belongs to one of them
};

// `cores` of this machine, 1 and up: fewer threads than that are one of the axes.
Plan planOf(const EvaluateOptions& options, unsigned cores);

}  // namespace ridgecast::evaluation
