#pragma once
// The mesh of a box: covers it exactly and keeps a vertical error in metres, for any viewpoint.
//
// Each height is evaluated once, on a grid in memory (samples.h), and triangles are judged by it whenever they change (judge.h). If the
// ground is rough for the error, the grid starts finer. The box's sides are divided first, each as a line. Then the worst points are
// inserted (Garland and Heckbert 1995): one by one while triangles are few, then in sweeps, region by region and side by side. Finally
// every triangle is proven against all samples and what may lie between them; one that fails gets a vertex, or finer samples where the
// existing ones cannot decide. Vertices that prove unnecessary are removed, which saves more than the proof cost. Vertices' heights lie on
// the coarsest lattice that costs at most a sixteenth of the error. The result depends only on terrain, box and error, not on threads.

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/terrain/terrain.h"
#include "server/box/problem.h"
#include "server/scheduling/pool.h"

namespace ridgecast::box {

struct Box {
  lattice::Point low, high;  // steps, low < high
  double error = 1;          // metres
};

struct BoxMesh {
  std::vector<mesh::LeafMesh> leaves;  // all of one level, canonical, none empty
  lattice::Point low, high;            // the covered area: the box, widened to the vertices' lattice (by at most a quarter of the error)
  double error = 0;                    // metres, with what may lie between samples; at most the requested one
  bool proven = false;  // by the posts of a height map; otherwise measured: samples bound what lies between them, by experience
  double spacing = 0;   // metres between samples where they are farthest apart
  std::uint64_t samples = 0;
  std::uint32_t triangles = 0;
};

// Incremental meshing: callers that share threads run a few milliseconds at a time. The turns do not affect the result. One thread at a
// time; terrain and pool must outlive it.
//
// Problems: more than `mostTriangles` would be needed, the error cannot be reached (a cliff), or the watch is over.
class Meshing {
 public:
  using Time = std::chrono::steady_clock::time_point;

  Meshing(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool, Watch watch);
  ~Meshing();
  // Works until about `until`. Empty: not finished. Must not be called again once it is.
  std::optional<Result<BoxMesh>> work(Time until);

 private:
  class Mesher;
  std::unique_ptr<Mesher> mesher_;
};

// All of it in one turn.
Result<BoxMesh> meshBox(const terrain::Terrain& terrain, const Box& box, std::uint32_t mostTriangles, scheduling::Pool& pool,
                        const Watch& watch);

}  // namespace ridgecast::box
