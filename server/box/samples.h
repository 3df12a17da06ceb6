#pragma once
// Heights over an area, each evaluated once: square tiles of a grid, coarse at first, and finer where refine() is called.
//
// Between its points the grid stands for the surface that is bilinear in each cell. `slack` bounds how far the terrain is from it: for a
// height map cell by cell, below and above, by the second differences of its posts, which bound the curvature of the bicubic between them
// (map_tile.h); for a formula block by block, by the second differences of the samples, with a margin: a measurement, not a proof. The
// effect of a formula's rounding on slopes is left out: the plan leaves room for it.
//
// Frame: units of 2^unitBits steps, relative to an anchor, as the mesh's points; heights in metres. One thread at a time, but for fill().

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"
#include "common/triangulation/predicates.h"

namespace ridgecast::box {

// The units of a mesh's points.
struct Frame {
  lattice::Point anchor;
  int unitBits = 0;
  lattice::Point global(triangulation::Point2 p) const {
    return {anchor.x + (lattice::Step{p.x} << unitBits), anchor.z + (lattice::Step{p.z} << unitBits)};
  }
  triangulation::Point2 local(lattice::Point p) const {
    return {static_cast<std::int32_t>((p.x - anchor.x) >> unitBits), static_cast<std::int32_t>((p.z - anchor.z) >> unitBits)};
  }
};

// How far the terrain may lie below and above the bilinear surface, metres, at least 0.
struct Slack {
  float below = 0, above = 0;
  float most() const { return std::max(below, above); }
};

// A square of samples. Where a block of 4 x 4 cells is refined, a tile of 8 x 8 covers it.
struct Tile {
  static constexpr int kBlockBits = 2;

  triangulation::Point2 corner;
  std::int32_t bits, cellBits;  // its samples are 2^bits units apart, and 2^cellBits + 1 along a side
  std::int32_t slackBits;       // the slack is known of squares of 2^slackBits cells
  float* height = nullptr;      // metres, along x first
  Slack* slack = nullptr;       // by square, along x first
  float most = 0;               // of all slack, metres
  float rough = -1;             // all slack, on average; negative: it is not filled yet
  std::int32_t finer = -1;      // where its blocks' tiles are listed; negative: no block is refined
  std::int32_t coarser = -1;    // the tile whose block it refines: every second of its samples is there
  std::int32_t cells() const { return 1 << cellBits; }
  std::int32_t across() const { return cells() + 1; }
  std::size_t count() const { return static_cast<std::size_t>(across()) * static_cast<std::size_t>(across()); }  // heights
  std::size_t squares() const { return std::size_t{1} << 2 * (cellBits - slackBits); }
  std::int32_t blocks() const { return cells() >> kBlockBits; }                    // along a side
  double spacing() const { return static_cast<double>(std::int64_t{1} << bits); }  // units
  std::int32_t side() const { return cells() << bits; }                            // units
  std::size_t index(std::int32_t i, std::int32_t j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(across()) + static_cast<std::size_t>(i);
  }
  std::size_t block(std::int32_t i, std::int32_t j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(blocks()) + static_cast<std::size_t>(i);
  }
  Slack slackOf(std::int32_t i, std::int32_t j) const {  // of a cell
    return slack[(static_cast<std::size_t>(j >> slackBits) << (cellBits - slackBits)) + static_cast<std::size_t>(i >> slackBits)];
  }
};
struct Block {
  std::size_t tile = 0, block = 0;
};

// Memory for many small arrays that are freed together.
template <class T>
class Shelf {
 public:
  T* take(std::size_t count) {
    if (count > left_) {
      left_ = std::max(count, kLength);
      boards_.push_back(std::make_unique_for_overwrite<T[]>(left_));
      next_ = boards_.back().get();
    }
    left_ -= count;
    return std::exchange(next_, next_ + count);
  }

 private:
  static constexpr std::size_t kLength = 1 << 18;
  std::vector<std::unique_ptr<T[]>> boards_;
  T* next_ = nullptr;
  std::size_t left_ = 0;
};

class Samples {
 public:
  static constexpr int kCellBits = 5;  // of the tiles at first

  // Covers low..high with samples 2^bits units apart.
  Samples(const terrain::Terrain& terrain, const Frame& frame, triangulation::Point2 low, triangulation::Point2 high, int bits);

  std::size_t size() const { return tiles_.size(); }  // tiles
  std::uint64_t count() const { return count_; }      // heights
  const Tile& operator[](std::size_t k) const { return tiles_[k]; }
  lattice::Step spacing() const { return lattice::Step{1} << (bits_ + frame_.unitBits); }  // steps, at first
  bool proves() const;                                                                     // slack is a proof everywhere
  void fill(std::size_t tile);  // asks for its heights; different tiles at the same time
  float slack() const;          // of all tiles, on average, metres
  // Halves the spacing of the first samples, all to be filled again, unless that takes more than `most`. Call before any block is refined.
  bool halves(std::uint64_t most);
  // Halves a block's spacing, in a tile appended at the end, to be filled; bits > 0.
  void refine(const Block& block);
  // The height at a sample that is filled, metres.
  std::optional<float> at(triangulation::Point2 p) const;
  // The tile that refines a block, or negative.
  std::int32_t finer(const Block& at) const {
    const std::int32_t names = tiles_[at.tile].finer;
    return names < 0 ? -1 : finer_[static_cast<std::size_t>(names) + at.block];
  }

  // f(tile) for the first tiles that meet low..high, or for one of each square of 2^skip x 2^skip of them.
  template <class F>
  void forEach(triangulation::Point2 low, triangulation::Point2 high, F&& f, int skip = 0) const {
    const int shift = bits_ + kCellBits;
    const auto clamped = [](std::int32_t v, std::int32_t most) { return v < 0 ? 0 : v >= most ? most - 1 : v; };
    const std::int32_t i1 = clamped((high.x - first_.x) >> shift, across_), j1 = clamped((high.z - first_.z) >> shift, down_),
                       apart = 1 << skip;
    const auto first = [&](std::int32_t v, std::int32_t most) { return (clamped(v >> shift, most) + apart - 1) & -apart; };
    for (std::int32_t j = first(low.z - first_.z, down_); j <= j1; j += apart)
      for (std::int32_t i = first(low.x - first_.x, across_); i <= i1; i += apart)
        f(static_cast<std::size_t>(j) * static_cast<std::size_t>(across_) + static_cast<std::size_t>(i));
  }

 private:
  void lay();
  void add(triangulation::Point2 corner, int bits, int cellBits, std::int32_t coarser = -1);
  void ask(Tile& tile) const;
  void measure(Tile& tile) const;

  const terrain::Terrain& terrain_;
  const terrain::Raster* const map_;
  const Frame frame_;
  const triangulation::Point2 low_, high_;
  triangulation::Point2 first_;
  int bits_;
  std::int32_t across_, down_;
  std::vector<Tile> tiles_;
  std::vector<std::int32_t> finer_;  // tiles, by block of each tile that has refined ones; or negative
  Shelf<float> heights_;
  Shelf<Slack> slacks_;
  std::uint64_t count_ = 0;
};

}  // namespace ridgecast::box
