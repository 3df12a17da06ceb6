#pragma once
// One camera's mesh and the iteration that keeps it fit for what the camera sees:
//   select -> generate -> refine -> triangulate
// The only place that sees all stages. Not thread-safe: one thread calls at a time (the session's strand); inside, an iteration
// spreads over the camera's pool. The result depends on the sequence of cameras and settings alone, not on threads or time.

#include <cstdint>
#include <memory>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/mesh/leaf_state.h"
#include "common/settings/settings.h"
#include "common/terrain/terrain.h"
#include "server/scheduling/pool.h"

namespace ridgecast::generation {
class CameraMesh;
}

namespace ridgecast::pipeline {

struct Limits {
  std::uint32_t defaultBudget = settings::kDefaultBudget;
  std::uint32_t maxBudget = settings::kMostBudget;
};

// The settings with defaults filled in and limits applied (common/settings; candidates: settings::kMaxCandidates).
settings::Settings grant(const settings::Settings& asked, const Limits& limits);

class Pipeline {
 public:
  Pipeline(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // One iteration. `camera` must satisfy camera::isValid.
  settings::Figures iterate(const camera::Camera& camera);

  // From the next iteration on. Another threshold, or a budget that the mesh was made for, goes on with the mesh there is; another metric
  // or a larger budget begins anew, with versions that go on.
  void change(const settings::Settings& granted);

  // At most so many vertices are inserted by one iteration, the most wanted first; never more than 24,000. For clients whose line is
  // narrow: what is postponed is detail.
  void setInsertionLimit(std::uint32_t most);

  // Whether the last iteration changed nothing and another one with the same camera would change nothing: the mesh then keeps
  // Figures::effectiveThreshold wherever the camera sees it, the ground narrower than twelve of its pixels and jumps narrower than the
  // lattice excepted. Before it says so, the camera has looked at everything closely.
  bool settled() const;

  // The leaves with their triangles as of the last iteration, in canonical order of address. The client should hold exactly these.
  const std::vector<mesh::LeafState>& leaves() const;

  // A leaf's mesh in canonical order. `address` must be one of leaves(). May be called from several threads between iterations.
  mesh::LeafMesh extract(lattice::LeafAddress address) const;

  // The candidates that the camera of the last iteration may see, the worst first, at most so many: where the mesh would grow next. A pass
  // over all triangles in view; spreads over the pool. The same for any number of threads.
  std::vector<lattice::Candidate> candidates(std::uint32_t most) const;

  // Bytes of memory that this camera's mesh uses: pages in use of all records and arrays.
  std::size_t memoryBytes() const;

  // The mesh of the last iteration. For checks.
  const generation::CameraMesh& mesh() const;

  // Horizontal distance in metres at which the world ends for this camera; what is drawn fades out before it.
  static constexpr double kHorizon = 32'000.0;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace ridgecast::pipeline
