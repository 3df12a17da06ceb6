#pragma once
// A layer being written: operations change its tiles in place, in turns whose cost is in posts examined (about 30 ns each). Arguments
// must outlive the turns.

#include <cstdint>
#include <map>
#include <memory>

#include "common/edits/layer.h"
#include "common/edits/operation.h"
#include "common/outcome/turns.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

inline constexpr lattice::Step kHalfDiagonal = 1449;  // of a tile, steps
constexpr lattice::Point middleOf(TileAddress t) {
  return {(t.i * kTileSide + kTileSide / 2) << kPostBits, (t.j * kTileSide + kTileSide / 2) << kPostBits};
}

class Draft {
 public:
  explicit Draft(std::shared_ptr<const Layer> on) : on_(std::move(on)) {}

  // `within`: changes only these tiles; null: all that it reaches. Adds the posts examined, weighted by effort, to `looked`.
  Turns apply(const terrain::Terrain& terrain, const Operation& operation, const TileSet* within, std::uint64_t& looked);

  // What was written since it was made.
  TileSet written() const;
  // Copies these tiles from here into another layer. Each intermediate layer is whole.
  Turns copy(const TileSet& tiles, std::shared_ptr<const Layer>& to) const;

 private:
  using Tiles = std::map<TileAddress, std::shared_ptr<const Tile>>;
  const std::shared_ptr<const Tile>& tile(TileAddress address) const;
  TilePosts postsOf(TileAddress address) const;
  Turns smooth(const terrain::Terrain& terrain, const Operation& operation, const TileSet* within, std::uint64_t& looked);
  void brushTile(const terrain::Terrain& terrain, const Operation& operation, const Brush& brush, TileAddress address);

  std::shared_ptr<const Layer> on_;
  Tiles tiles_;
};

}  // namespace ridgecast::edits
