#pragma once
// What edits have made of the ground: for every post the steps by which it lies above the terrain's own height, and its material. Sparse,
// in tiles of 16 x 16 posts (8 m); a tile that is not there is all 0. A Layer is a value that never changes: another edit makes another
// layer, which shares all tiles that stayed. Any thread.
//
// Law: who reads the posts around a place (one before it to two after it) finds tiles wherever one of them is not 0, or finds no tile at
// the place itself. So ground without a tile is the terrain's own, and that is all it takes to know.

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <unordered_map>
#include <vector>

#include "common/edits/operation.h"
#include "common/lattice/lattice.h"

namespace ridgecast::edits {

inline constexpr int kTileBits = 4;  // posts, as a power of two
inline constexpr std::int64_t kTileSide = 1 << kTileBits;
inline constexpr int kTileStepBits = kPostBits + kTileBits;

struct Tile {
  std::array<std::int32_t, kTileSide * kTileSide> rise{};      // along x first
  std::array<std::uint8_t, kTileSide * kTileSide> material{};  // 0: the ground's own
  friend bool operator==(const Tile&, const Tile&) = default;
};

struct TileAddress {
  std::int64_t i = 0, j = 0;  // posts [i, i + 1) x 16 along x, j along z
  friend constexpr auto operator<=>(const TileAddress&, const TileAddress&) = default;
  Posts posts() const { return {i * kTileSide, j * kTileSide, (i + 1) * kTileSide, (j + 1) * kTileSide}; }
};
using TileSet = std::set<TileAddress>;

class Layer {
 public:
  const Tile* tile(TileAddress address) const;
  std::size_t tiles() const { return tiles_; }
  std::size_t bytes() const { return tiles_ * sizeof(Tile) + blocks_ * sizeof(Block) + cells_.size() * sizeof(Cell); }
  bool empty() const { return tiles_ == 0; }
  std::vector<TileAddress> addresses() const;  // ascending
  // Those that meet the posts.
  void forEachTile(const Posts& posts, const std::function<void(TileAddress, const Tile&)>& f) const;
  // Equal for layers with equal ground, whatever made them.
  std::uint64_t hash() const;

  // Steps above the terrain's own height at a post.
  std::int32_t riseAt(std::int64_t x, std::int64_t z) const;

  // Adds the metres between posts to heights that a terrain returned for these places.
  void raise(const lattice::Step* x, const lattice::Step* z, float* heights, std::size_t count) const;
  // Of the nearest post.
  std::uint8_t materialAt(lattice::Point p) const;

  // This layer with other tiles, ascending by address, each once; an empty pointer: none is there. The law above is seen to.
  struct Change {
    TileAddress address;
    std::shared_ptr<const Tile> tile;
  };
  std::shared_ptr<const Layer> with(const std::vector<Change>& changes) const;

 private:
  // A cell of the lattice has 32 x 32 blocks of 16 x 16 tiles.
  static constexpr int kBlockBits = 4, kCellBits = lattice::kCellBits - kTileStepBits - kBlockBits;
  using Block = std::array<std::shared_ptr<const Tile>, std::size_t{1} << (2 * kBlockBits)>;
  using Cell = std::array<std::shared_ptr<const Block>, std::size_t{1} << (2 * kCellBits)>;
  struct CellAddress {
    std::int64_t i = 0, j = 0;
    friend bool operator==(const CellAddress&, const CellAddress&) = default;
  };
  struct HashOfCell {
    std::size_t operator()(const CellAddress& a) const {
      return static_cast<std::size_t>(lattice::mix(static_cast<std::uint64_t>(a.i) + lattice::mix(static_cast<std::uint64_t>(a.j))));
    }
  };
  class Writer;
  class CellFinder;
  const Cell* cell(CellAddress address) const;
  static const Tile* tileOf(const Cell& cell, TileAddress address);
  void raiseTogether(const Posts& posts, const lattice::Step* x, const lattice::Step* z, float* heights, std::size_t count) const;
  void raiseApart(const lattice::Step* x, const lattice::Step* z, float* heights, std::size_t count) const;
  void copyAround(const Tile& here, std::int64_t x, std::int64_t z, std::array<std::int32_t, 16>& out) const;

  std::unordered_map<CellAddress, std::shared_ptr<const Cell>, HashOfCell> cells_;
  std::size_t tiles_ = 0, blocks_ = 0;
};

}  // namespace ridgecast::edits
