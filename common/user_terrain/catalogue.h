#pragma once
// The terrains a server can start with: built-in ones, a user's own GLSL (glsl/compiled.h), and height maps (raster/raster_terrain.h). A
// file NAME.raster beside a map says how it is read: a line for each setting that --raster takes, drape=FILE and classes=FILE, from
// there; # begins a comment.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "common/glsl/compiled.h"
#include "common/outcome/outcome.h"
#include "common/raster/raster_options.h"
#include "common/terrain/terrain.h"

namespace ridgecast::user_terrain {

struct Request {
  std::string terrain = "alpine";            // a built-in name, a name in `folder`, or a path: .glsl, or a height map
  std::filesystem::path folder;              // of NAME.glsl and height maps (isRasterName), each available as NAME; empty: none
  std::vector<glsl::Assignment> parameters;  // other values than the file's
  raster::RasterOptions raster;              // of a height map without a NAME.raster
  glsl::Build build;                         // of a .glsl
  std::uint32_t seed = 1;
};

// Any thread. `stop` ends its child processes within milliseconds. Error: one sentence for the
// user, with file and line if there is one, or a stop.
Outcome<std::shared_ptr<const terrain::Terrain>> load(const Request& request, glsl::Complain complain, const std::stop_token& stop = {});

// The files that load() reads for this terrain, or would if they were there; those that a map names, while it is in use.
std::vector<std::filesystem::path> filesOf(const Request& request);

struct Entry {
  std::string name, summary;
  std::vector<glsl::Parameter> parameters;
  std::string problem;  // why a file of the folder is no terrain; empty: it can be loaded
};
// The built-in terrains, then the files of `folder` by name: GLSL is read but not compiled, maps are not opened. Error: no such folder.
Outcome<std::vector<Entry>> list(const std::filesystem::path& folder);

}  // namespace ridgecast::user_terrain
