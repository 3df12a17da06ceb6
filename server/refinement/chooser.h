#pragma once
// Chooses triangles' candidates from the terrain, and asks it whatever else a mesh must know. Calls may run at the same time unless they
// change something.

#include <atomic>
#include <memory>
#include <span>
#include <vector>

#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"
#include "server/refinement/colour_error.h"
#include "server/refinement/metric.h"
#include "server/refinement/view.h"

namespace ridgecast::refinement {

class Chooser {
 public:
  // `colourError`: the bound of ColourError; 0: off.
  Chooser(const triangulation::Triangulation& mesh, std::shared_ptr<const terrain::Terrain> terrain, Metric metric, double colourError);
  // The terrain differs from the previous one within these areas.
  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain, std::span<const lattice::Area> changed);
  const std::vector<lattice::Area>& changed() const { return changed_; }
  const ColourError& colour() const { return colour_; }

  std::vector<std::int32_t> heightsAt(std::span<const lattice::Point> points);  // steps; points absolute
  // Curvatures are needed by kThesis alone: of new vertices, and of vertices that have moved.
  void addCurvatures(std::span<const triangulation::VertexId> vertices, lattice::Point anchor);
  void moveCurvatures(std::span<const triangulation::Move> moves);
  std::uint64_t heights() const { return heights_.load(std::memory_order_relaxed); }  // evaluated so far

  // Of triangles of one region: the candidates, in order, none where the error is 0; the terms of the region's hash (common/mesh); and the
  // heights that were seen. Valid until this thread's next call. `closely`: null: see View::closely.
  struct Choice {
    std::span<const Candidate> candidates;
    std::span<const std::uint64_t> terms;
    HeightRange seen;
  };
  Choice choose(std::span<const triangulation::TriangleId> triangles, lattice::Point anchor, int level, const View* closely);

 private:
  struct Scratch;
  void readBatch(std::size_t begin, std::size_t count, Scratch& scratch) const;
  void tryPoints(std::size_t begin, std::size_t count, const View* closely, Scratch& scratch) const;
  void tryChanged(std::uint32_t slot, Scratch& scratch) const;
  void tryThesisPoint(std::uint32_t slot, Scratch& scratch) const;
  void judgeTrials(const View* closely, Scratch& scratch);
  void judgeColours(Scratch& scratch) const;

  const triangulation::Triangulation& mesh_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  const Metric metric_;
  ColourError colour_;
  triangulation::Records<float> curvatures_;  // by vertex, metres; none but for kThesis
  std::vector<lattice::Area> changed_;
  std::atomic<std::uint64_t> heights_{0};
};

}  // namespace ridgecast::refinement
