#pragma once
// The terrains a server can be started with: the built-in ones, files of a person's own, and height maps (raster_terrain.h).
//
// A GLSL file is checked (check.h), translated (translate.h), compiled for this machine and cached (library.h), tried in a child process
// (probe.h) and loaded. From then on its heights are looked at batch by batch: what is no number becomes 0, what is absurd is clamped,
// loops end after kMostSteps steps, and the first such place is reported.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/terrain/declaration.h"
#include "server/terrain/raster_options.h"

namespace ridgecast::user_terrain {

struct Request {
  std::string terrain = "alpine";      // a built-in name, a name in `folder`, or a path that ends in .glsl, .tif, .png, .r16 or .raw
  std::filesystem::path folder;        // of terrain files, NAME.glsl each; empty: none
  std::vector<Assignment> parameters;  // a built-in terrain is compiled like a file when one is given
  RasterOptions raster;                // of a height map
  std::filesystem::path cache;         // empty: the user's own, see Cache::open
  std::string variant;                 // "baseline", "avx2", "avx512"; empty: the best that this machine can run
  std::uint32_t seed = 1;
  bool colours = false;  // must be had in C++: a private terrain's travel with its vertices. Else they may be missing
};

// Called once a terrain, with one sentence, when a height turns out bad after all; from whatever thread asked for it.
using Complain = std::function<void(const std::string&)>;

// Forks: call it before other threads work. Error: one sentence for a person, with file and line where there is one.
Outcome<std::shared_ptr<const terrain::Terrain>> load(const Request& request, Complain complain);

struct Entry {
  std::string name, summary;
  std::vector<Parameter> parameters;
  std::string problem;  // why a file of the folder cannot be read; else empty
};
// The built-in terrains, then the files of `folder` by name; those are read, not compiled. Error: there is no such folder.
Outcome<std::vector<Entry>> list(const std::filesystem::path& folder);

}  // namespace ridgecast::user_terrain
