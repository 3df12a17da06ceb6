#pragma once
// One camera's mesh and the iteration that adapts it to the view:
//   select -> generate -> refine -> triangulate
// The only place that sees all stages. Not thread-safe: one thread calls at a time (the session's strand); inside, an iteration
// spreads over the camera's pool. The result depends on the sequence of cameras and settings alone, not on threads or time.

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/camera/camera.h"
#include "common/lattice/lattice.h"
#include "common/mesh/leaf_mesh.h"
#include "common/settings/settings.h"
#include "common/terrain/terrain.h"
#include "server/refinement/stored_vertex.h"
#include "server/scheduling/pool.h"

namespace ridgecast::generation {
class CameraMesh;
}
namespace ridgecast::triangulation {
class Triangulation;
using VertexId = std::uint32_t;
}  // namespace ridgecast::triangulation

namespace ridgecast::pipeline {

struct Limits {
  std::uint32_t defaultBudget = settings::kDefaultBudget;
  std::uint32_t maxBudget = settings::kMaxBudget;
};

// The settings with defaults filled in and limits applied (common/settings; candidates: settings::kMaxCandidates).
settings::Settings grant(const settings::Settings& asked, const Limits& limits);

// A mesh between two iterations: enough for another one to go on with the same triangles, to the bit. Those of a Delaunay triangulation are
// a function of its vertices (common/triangulation), so none are stored.
struct MeshState {
  std::vector<lattice::LeafAddress> leaves;        // in canonical order
  std::vector<refinement::StoredVertex> vertices;  // by leaf, then by square of level 8 what lies outside them; in each by x, then z
  double effectiveThreshold = 0;                   // to which the budget has raised it
};

// A mesh that iterates and can be read between iterations. Pipeline is the implementation; with this interface a session can be tested
// without it.
class IteratingMesh {
 public:
  virtual ~IteratingMesh() = default;

  // One iteration. `camera` must satisfy camera::isValid.
  virtual settings::IterationStats iterate(const camera::Camera& camera) = 0;

  // Its state; nothing: it has none yet, or cannot be restored.
  virtual std::optional<MeshState> state() const { return {}; }
  // Before the first iteration: takes this state, whose heights are those of the terrain, or of one that the next setGround() differs from;
  // leaves() are then those that had it. It goes on for this camera. Nothing: no mesh of these settings has such a state, and this one is
  // as it was.
  virtual std::optional<settings::IterationStats> restore(const MeshState&, const camera::Camera&) { return {}; }

  // From the next iteration on. A new threshold, or a budget up to the one that the mesh was made for, keeps the mesh. A new metric, colour
  // error or larger budget rebuilds it; version numbers continue.
  virtual void change(const settings::Settings& granted) = 0;

  // From the next iteration on this is the ground. It differs from the previous one only within these areas; there the mesh takes the new
  // heights and is checked again.
  virtual void setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) = 0;

  // Limits the vertices that one iteration inserts, the most wanted first; never more than 24,000. For slow connections, or on a busy
  // machine: detail is postponed, and IterationStats::effectiveThreshold says how much.
  virtual void setInsertionLimit(std::uint32_t most) = 0;

  // Whether the last iteration changed nothing and another one with the same camera would change nothing: the mesh then keeps
  // IterationStats::effectiveThreshold everywhere in view, except features under twelve pixels wide and steps narrower than the lattice.
  // Before it says so, everything in view has been examined closely.
  virtual bool settled() const = 0;

  // The leaves with their triangles as of the last iteration, in canonical order of address. The client should hold exactly these.
  virtual const std::vector<mesh::LeafState>& leaves() const = 0;

  // A leaf's mesh in canonical order. `address` must be one of leaves(). May be called from several threads between iterations.
  virtual mesh::LeafMesh extract(lattice::LeafAddress address) const = 0;

  // The triangulation that the leaves are cut from, and where its origin lies. Valid until the next iterate() or change().
  struct Surface {
    const triangulation::Triangulation* mesh = nullptr;  // null: only leaves exist
    lattice::Point anchor;                               // absolute steps
    std::uint64_t outside = 0;                           // version of what is filed outside all leaves
  };
  virtual Surface surface() const { return {}; }
  // Where a leaf of leaves() is filed.
  virtual std::uint32_t region(lattice::LeafAddress) const { return 0; }
  // Appends the vertices filed under a leaf that are new, or have another height, since they were last taken, including those of ground
  // that was under other leaves then. For one reader.
  virtual void takeFresh(lattice::LeafAddress, std::vector<triangulation::VertexId>&) {}

  // At most `most` candidates that the camera of the last iteration may see, the worst first: where the mesh would grow next. A pass over
  // all triangles in view; spreads over the pool. The same for any number of threads.
  virtual std::vector<lattice::Candidate> candidates(std::uint32_t most) const = 0;
};

class Pipeline final : public IteratingMesh {
 public:
  Pipeline(std::shared_ptr<const terrain::Terrain> terrain, const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool);
  ~Pipeline() override;
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  settings::IterationStats iterate(const camera::Camera& camera) override;
  std::optional<MeshState> state() const override;
  std::optional<settings::IterationStats> restore(const MeshState& from, const camera::Camera& camera) override;
  void change(const settings::Settings& granted) override;
  void setGround(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed) override;
  void setInsertionLimit(std::uint32_t most) override;
  bool settled() const override;
  const std::vector<mesh::LeafState>& leaves() const override;
  mesh::LeafMesh extract(lattice::LeafAddress address) const override;
  Surface surface() const override;
  std::uint32_t region(lattice::LeafAddress address) const override;
  void takeFresh(lattice::LeafAddress address, std::vector<triangulation::VertexId>& out) override;
  std::vector<lattice::Candidate> candidates(std::uint32_t most) const override;

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
