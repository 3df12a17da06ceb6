#pragma once
// The results of a flight, as its folder keeps them: summary.json and iterations.jsonl. What was not measured is kNothing.

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "client/evaluation/numbers.h"
#include "common/wire/messages.h"

namespace ridgecast::evaluation {

struct Run {
  std::string name;  // also of its folder
  std::string terrain, metric;
  double threshold = 0;
  unsigned threads = 0;  // 0: all cores
  int repeat = 1;
  std::filesystem::path folder;  // with summary.json, iterations.jsonl and pictures, as `fly` leaves them
};

// SSIM of the mesh against the ray march of the same camera.
struct Likeness {
  double ssim = kNothing;
  double terrain = kNothing;     // where both see terrain alone
  double unfiltered = kNothing;  // both drawn without filtering
  double corrected = kNothing;   // of the corrected mesh
};

struct FrameTime {
  double ms = kNothing, cpuMs = kNothing;
};

// 1 - SSIM of each frame against the one before it.
struct Popping {
  double off = kNothing, on = kNothing;               // the worst, without and with morphing
  std::map<std::string, std::vector<double>> frames;  // of "off" and "on"; 0 where nothing changes
};

// What was flown, and how it was drawn.
struct FlightSettings {
  std::string metric;
  double threshold = 0;
  std::uint32_t budget = 0, width = 0, height = 0, samples = 1;  // samples of each pixel
  std::string pacing, path, terrain;
  std::uint32_t seed = 0;
  double horizon = 0;  // metres
  std::string server, renderer;
};

struct FlightSummary {
  struct {
    std::uint64_t count = 0;
    double least = kNothing;      // SSIM
    std::vector<double> ssim, t;  // of each; seconds of path time
    std::vector<std::string> names;
  } frames;                                 // along the path, not the settled one
  Likeness mean, settled;                   // of the frames; at the end
  double terrainShare = kNothing;           // of the settled picture
  FrameTime mesh, corrected, raymarch;      // medians
  std::uint64_t triangles = 0, leaves = 0;  // held at the end
  std::uint64_t iterations = 0, hashMismatches = 0, bytesReceived = 0, reconnections = 0;
  double iterationsPerSecond = kNothing;
  double latencyMsMean = 0, latencyMsMax = 0;
  bool isSettled = false;
  double settleSeconds = 0;
  Popping popping;
  FlightSettings settings;
};

// One iteration as the client saw it.
struct IterationResult {
  std::uint64_t number = 0, pose = 0;
  double t = 0;  // seconds of path time of its pose
  wire::IterationStats figures;
  double applyMs = 0;               // decoding and applying
  double latencyMs = 0;             // from sending its pose to having its message
  std::uint64_t trianglesHeld = 0;  // afterwards
  std::size_t leavesSent = 0, leavesGone = 0;
  std::uint64_t bytes = 0;  // of its message
  bool settled = false;
  bool hashOk = false;                            // the mesh held afterwards is the server's
  double uploadMs = kNothing, drawMs = kNothing;  // making leaves and bringing the graphics card up to date, and drawing
};

std::string asJson(const FlightSummary& summary);   // the text of summary.json
std::string asJson(const IterationResult& result);  // a line of iterations.jsonl

}  // namespace ridgecast::evaluation
