#pragma once
// The terrains a server can start with: built-in ones, a user's own files, and height maps (raster_terrain.h). A file NAME.raster beside a
// map says how it is read: a line for each setting that --raster takes, or drape=FILE, from there; # begins a comment.
//
// A GLSL file is checked (check.h), translated (translate.h), compiled for this machine and cached (library.h), tried in its own process
// (probe.h) and loaded. After that every batch of heights is checked: NaN becomes 0, absurd values are clamped, loops end after
// kMaxSteps steps, and the first such place is reported.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "common/user_terrain/declaration.h"
#include "common/user_terrain/raster_options.h"

namespace ridgecast::user_terrain {

struct Request {
  std::string terrain = "alpine";      // a built-in name, a name in `folder`, or a path: .glsl, or a height map
  std::filesystem::path folder;        // of NAME.glsl and height maps (isRasterName), each available as NAME; empty: none
  std::vector<Assignment> parameters;  // other values than the file's
  RasterOptions raster;                // of a height map without a NAME.raster
  std::filesystem::path cache;         // empty: the user's own, see Cache::open
  std::string variant;                 // "baseline", "avx2", "avx512"; empty: the best for this machine
  std::filesystem::path prober;        // a program whose main() calls asProbe (probe.h) first; tries what was compiled
  std::uint32_t seed = 1;
  bool colours = false;  // require colours in C++: a private terrain's travel with its vertices. Otherwise optional
};

// Called with what compiles but is no good ground, by load(), and once a terrain if a height turns out to be bad, on the
// thread that computed it.
using Complain = std::function<void(const std::string&)>;

// Any thread. `stop` ends its child processes within milliseconds. Error: one sentence for the
// user, with file and line if there is one, or a stop.
Outcome<std::shared_ptr<const terrain::Terrain>> load(const Request& request, Complain complain, const std::stop_token& stop = {});

// The files that load() reads for this terrain, or would if they were there; those that a map names, while it is in use.
std::vector<std::filesystem::path> filesOf(const Request& request);

struct Entry {
  std::string name, summary;
  std::vector<Parameter> parameters;
  std::string problem;  // why a file of the folder is no terrain; empty: it can be loaded
};
// The built-in terrains, then the files of `folder` by name: GLSL is read but not compiled, maps are not opened. Error: no such folder.
Outcome<std::vector<Entry>> list(const std::filesystem::path& folder);

}  // namespace ridgecast::user_terrain
