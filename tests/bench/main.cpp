// ridgecast-bench: one measured comparison a name; a table for people, with --json one object of named figures and nothing else.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>

#include "common/glsl/probe.h"
#include "tests/bench/bench.h"

namespace ridgecast::bench {

void progress(const std::string& text) { std::fprintf(stderr, "%s\n", text.c_str()); }

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

namespace {

struct Entry {
  const char* name;
  const char* summary;
  Report (*run)(const Options&);
};

const Entry kEntries[] = {
    {"delaunay", "insertion and removal against CGAL for the same points in the same order", delaunay},
    {"iteration", "whole iterations of a moving and of a hovering camera", iteration},
    {"threads", "two threads against one on a moving camera", threads},
    {"contention", "what cameras on different cores take from each other", contention},
    {"box", "the mesh of a box against greedy insertion over a height map", box},
    {"error", "the error on screen, measured by rays, against what was asked for", error},
    {"cameras", "many cameras on one server, real sockets, this machine", cameras},
    {"presence", "what members are told of each other, and what that costs a server", presence},
    {"deltas", "what changed in a leaf against sending the leaf whole", deltas},
    {"edits", "a log of edits: commits a second, cold starts from the cached ground and from the edits", edits},
    {"bus", "what servers share by Redis: synced appends by one and by sixteen, messages", bus},
    {"doors", "the stream against whole leaves, 3D Tiles and Terrarium tiles, along the evaluation's flights", doors},
    {"resume", "what a client that comes back costs: a start, a resume, a handover by a checkpoint", resume},
    {"soak", "an hour's flight: budget, memory, soundness", soak},
    {"rays", "rays to the true ground against the march by samples", rays},
    {"heights", "heights in batches against scalar double", heights},
};

int usage() {
  std::fprintf(stderr, "usage: ridgecast-bench NAME [--json] [--quick] [...]\n");
  for (const Entry& e : kEntries) std::fprintf(stderr, "  %-12s %s\n", e.name, e.summary);
  return 2;
}

void print(const Entry& entry, const Report& report, bool json) {
  if (json) {
    std::printf("{");
    const char* comma = "";
    for (const Figure& f : report.figures) {
      if (std::isfinite(f.value))
        std::printf("%s\"%s\": %.6g", comma, f.name.c_str(), f.value);
      else
        std::printf("%s\"%s\": null", comma, f.name.c_str());
      comma = ", ";
    }
    std::printf("}\n");
    return;
  }
  std::printf("%s: %s\n", entry.name, entry.summary);
  for (const std::string& n : report.notes) std::printf("  %s\n", n.c_str());
  for (const Figure& f : report.figures) std::printf("  %-32s %12.6g %s\n", f.name.c_str(), f.value, f.unit.c_str());
}

}  // namespace
}  // namespace ridgecast::bench

int main(int argc, char** argv) {
  using namespace ridgecast::bench;
  if (const auto status = ridgecast::glsl::asProbe(argc, argv)) return *status;
  Options options;
  options.programFolder = std::filesystem::weakly_canonical(argv[0]).parent_path().string();
  bool json = false;
  std::string name;
  for (int k = 1; k < argc; ++k) {
    if (!std::strcmp(argv[k], "--json"))
      json = true;
    else if (!std::strcmp(argv[k], "--quick"))
      options.quick = true;
    else if (name.empty())
      name = argv[k];
    else
      options.arguments.emplace_back(argv[k]);
  }
  // Without a name every bench runs; a part of a name runs those that hold it.
  int ran = 0;
  try {
    for (const Entry& entry : kEntries) {
      const bool exact = name == entry.name;
      const bool part = std::strstr(entry.name, name.c_str()) != nullptr;
      if (!exact && (json || !part)) continue;
      print(entry, entry.run(options), json);
      std::fflush(stdout);
      ++ran;
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "ridgecast-bench: %s\n", e.what());
    return 1;
  }
  return ran > 0 ? 0 : usage();
}
