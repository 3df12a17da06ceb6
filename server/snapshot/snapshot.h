#pragma once
// A mesh as a file: of a live camera, a pose, a box or a tile of 3D Tiles (question.h). Works on its own threads, with a share of the cores
// while cameras work. Each calling thread makes one snapshot at a time.
//
// asset.extras, which are also the metadata:
//   of            "camera", "pose", "box", "tile" or, of a GeoTIFF, "grid": with columns, rows and pitch {x, z} (metres)
//   session, terrain, seed, parameters {name: value}, contentHash (16 hexadecimal digits)
//   pose          x, z, y (metres, absolute), altitude, yaw, pitch, fov (degrees, as in path files), width, height; of camera and pose
//   camera        id, iteration, meshHash (as acknowledged by its client); of a live camera
//   box           x0, z0, x1, z1 (metres; the covered area, at most a quarter of the error wider than requested)
//   error         unit ("metres" for a box or tile, otherwise the metric: "pixels", "area" or "thesis"), asked, kept; for a box or tile
//                 also known ("proven" by a height map's posts or "measured"), spacing (metres) and number of samples; of a tile with
//                 ramps (server/tileset/tile.h) ramp (metres)
//   origin        x, z (metres): what to add to a coordinate of the file
//   georeference  crs (as the map's file names it; absent if unknown), easting, northing (metres): of the file's origin, so that a vertex
//                 has easting + x, northing - z; longitude, latitude (degrees); only of a height map that says where it lies
//   leaves, triangles, vertices (of all leaves, shared ones each time), latticeStep; cellX, cellZ with origin=cell
// A tile has two nodes, "surface" and "skirt" (server/tileset/tile.h).

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "server/box/problem.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot/question.h"
#include "server/tileset/tileset.h"

namespace ridgecast::snapshot {

using box::Problem;
using box::Result;

struct Snapshot {
  std::string file;                         // empty if only the metadata were requested
  std::string metadata;                     // JSON
  std::string name;                         // of a file, with its ending
  std::optional<tileset::Known> tile = {};  // of a tile
};

struct Progress : box::Progress {
  enum class Stage { kMeshing, kSampling, kColouring, kPainting, kWriting };
  std::atomic<Stage> stage{Stage::kMeshing};
  std::atomic<std::uint32_t> part{0}, parts{1};  // of a large map: those that are meshed, and all
  std::string text() const;                      // a few words for people
};

class Snapshots {
 public:
  // threads 0: one less than the hardware has, at least one. `cameras`: whose work has priority; null: nobody's.
  explicit Snapshots(const Limits& limits, unsigned threads = 0, const scheduling::Executor* cameras = nullptr);

  const Limits& limits() const { return limits_; }

  // Of this ground of the session; of a live camera's mesh, whatever ground that is of. Blocks until the snapshot is made; call it on its
  // own thread. Any thread.
  Result<Snapshot> take(const session::Session& session, editing::Ground ground, const Question& question, bool metadataOnly,
                        std::stop_token stop, Progress* progress = nullptr);

  // Equal for equal files; empty if only the file itself can tell (a live camera).
  static std::string etag(const session::Session& session, const editing::Ground& ground, const Question& question, bool metadataOnly);

 private:
  const Limits limits_;
  scheduling::Executor executor_;
};

}  // namespace ridgecast::snapshot
