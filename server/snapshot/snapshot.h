#pragma once
// A mesh at a moment as a file: of a live camera, of a pose, of a box (question.h). Works on threads of its own that give way to all
// cameras; one snapshot is made at a time by each thread that asks.
//
// asset.extras, and the metadata alone:
//   of            "camera", "pose" or "box"
//   session, terrain, seed, parameters {name: value}, contentHash (16 hexadecimal digits)
//   pose          x, z, y (metres, absolute), altitude, yaw, pitch, fov (degrees, as in path files), width, height; of camera and pose
//   camera        id, iteration, meshHash (as acknowledged by its client); of a live camera
//   box           x0, z0, x1, z1 (metres: what is covered, at most a quarter of the error wider than asked for)
//   error         unit ("metres" of a box, else the metric: "pixels", "area" or "thesis"), asked, kept; of a box also samples: kept is the largest error found on so many points
//   leaves, triangles, vertices (of all leaves, shared ones each time), cellX, cellZ, latticeStep

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "server/box/problem.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "server/snapshot/question.h"

namespace ridgecast::snapshot {

using box::Problem;
using box::Result;

struct Snapshot {
  std::string glb;       // empty when only the metadata were wanted
  std::string metadata;  // JSON
  std::string name;      // of a file, without its ending
};

// How far a snapshot has come. Written while it is made, read by any thread meanwhile.
struct Progress {
  enum class Stage { kWaiting, kMeshing, kColouring, kWriting };
  std::atomic<Stage> stage{Stage::kWaiting};
  std::atomic<std::uint32_t> triangles{0};  // so far
  std::string text() const;                 // a few words for people
};

class Snapshots {
 public:
  // threads 0: one less than there are, at least one. `cameras`: whose work goes first; none: nobody's.
  explicit Snapshots(const Limits& limits, unsigned threads = 0, const scheduling::Machine* cameras = nullptr);

  const Limits& limits() const { return limits_; }

  // Blocks until it is made: for a thread of its own. Any thread.
  Result<Snapshot> take(const session::Session& session, const Question& question, bool metadataOnly, std::stop_token stop,
                        Progress* progress = nullptr);

  // Equal for equal files; empty where only the file itself can tell (a live camera).
  static std::string etag(const session::Session& session, const Question& question, bool metadataOnly);

 private:
  const Limits limits_;
  scheduling::Machine machine_;
};

}  // namespace ridgecast::snapshot
