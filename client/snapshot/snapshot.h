#pragma once
// `ridgecast-client snapshot`: a file of a pose, a live camera or a box, made by a server. If a terrain is named (Offline), the server's
// program makes that one file, or a folder of tiles, and serves nothing.

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/link/connection.h"

namespace ridgecast::snapshot {

// A terrain without a server that runs: settings of `ridgecast-server`.
struct Offline {
  std::string terrain;                          // a name, a terrain file or a height map
  std::vector<std::string> parameters, raster;  // NAME=VALUE
  std::filesystem::path drape;                  // a picture on the height map; empty: none
  std::filesystem::path folder;                 // of terrain files; empty: none
  std::uint32_t seed = 1;
  std::uint32_t triangles = 20'000'000;  // at most
  std::filesystem::path program;         // empty: ridgecast-server beside this one
};

// What a mesh is refined for.
struct Pose {
  double x = 0, z = 0, altitude = 120, yaw = 0, pitch = -10, fov = 60;  // metres, degrees
  double threshold = 0.6;                                               // pixels
  double colourError = 0;                                               // as of settings::Settings
};

struct SnapshotOptions {
  core::Url url;
  std::optional<Offline> offline;
  std::filesystem::path out;            // a file; of Offline...
  std::filesystem::path tiles;          // ...or a folder of 3D Tiles, or a .pmtiles
  std::string layer;                    // of a .pmtiles: heights or colours; empty: heights
  std::optional<int> zoom;              // of a .pmtiles: the finest level; none: as the map's samples
  std::string heights;                  // from where those of tiles count: sea or ellipsoid; empty: as the server does
  std::string at;                       // LON,LAT[,HEIGHT] of the middle of tiles, of a .pmtiles of the origin; empty: none
  std::optional<std::uint64_t> camera;  // a live one; otherwise...
  std::string box, crs;                 // ...as of server/snapshot/question.h; empty box: the pose; empty crs: metres of the world
  double error = 1;                     // metres, of a box
  double spacing = 0;                   // metres, of a .tif; 0: the height map's own
  Pose pose;
  std::uint32_t width = 1280, height = 720;  // pixels, of a pose
  bool draco = false, normals = true, colours = true, materials = false, metadata = false;
  std::string origin = "cell";  // as of server/snapshot/question.h
  std::string up = "y";         // z: of a .ply or .obj
  std::uint32_t texture = 0;    // pixels; 0: none
  double timeout = 120;         // seconds
};

// The server program's arguments for the terrain.
std::vector<std::string> arguments(const Offline& offline);
// The server's program: the one that was named, or the one beside this one.
std::filesystem::path programOf(const Offline& offline);

// Path and query of the request.
std::string target(const SnapshotOptions& options);
std::string query(const SnapshotOptions& options);

// Reports progress on stderr and what was written on stdout. Exit code: 0 done, 1 failed, with one sentence on stderr.
int snapshot(const SnapshotOptions& options);

}  // namespace ridgecast::snapshot
