#pragma once
// Colour as an error in steps, so that refinement can follow what vertices carry (common/terrain/shades.h) where the ground is flat.
//
// Where the terrain's colour differs from the mesh's, interpolated between corners, by more than the bound, it counts as an error of
// kSmear x difference x the triangle's longest side: that far the colour is smeared. So triangles become shorter along a shore until the
// smear is below the threshold on the screen. Like an error of height it is foreshortened: from straight above nothing is seen of it.

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "common/terrain/terrain.h"
#include "common/triangulation/triangulation.h"

namespace ridgecast::refinement {

// Square roots of linear red, green and blue, 0..1, to 1/255: as vertices carry them.
using Tint = std::array<float, 3>;

class ColourError {
 public:
  static constexpr double kSmear = 0.25;
  // Of the bound: differences down to here keep an existing vertex, so that nothing flickers.
  static constexpr double kKept = 0.5;

  // `bound`: of the largest difference of red, green or blue, 0..1; 0 or a terrain without colours: no colour is an error.
  ColourError(std::shared_ptr<const terrain::Terrain> terrain, double bound);
  void setTerrain(std::shared_ptr<const terrain::Terrain> terrain) { terrain_ = std::move(terrain); }
  bool on() const { return bound_ > 0; }

  // In a leaf of this level; points relative to the anchor. `out` has the same size. Any thread.
  void tints(lattice::Point anchor, std::span<const triangulation::Point2> points, int level, std::span<Tint> out) const;

  struct Corner {
    triangulation::Vertex at;
    Tint tint;
  };
  // Steps: what the mesh's colour at `p` in this triangle counts for. `share`: of the bound.
  double at(const std::array<Corner, 3>& corners, triangulation::Point2 p, const Tint& tint, double share = 1) const;

 private:
  std::shared_ptr<const terrain::Terrain> terrain_;
  double bound_;
};

}  // namespace ridgecast::refinement
