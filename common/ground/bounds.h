#pragma once
// Internal to the room: bounds of the ground over squares of the lattice, made where they are asked for and kept with the terrain.
//
// A square of level k has 4 x 4 cells with a side of 1/4 m x 4^k: it is a cell of level k + 1. The ground over a cell lies below its
// `high`, and no further from the bilinear surface through its corners than that is from the highest of them: by its margin. Proven for
// height maps (terrain::Relief), measured for octaves: there the margin is made from the second differences of the heights at the
// corners, of wide cells also around the square. Its constants were chosen by comparing 17 x 17 heights in each of 1.2 million cells of
// the built-in terrains: the worst was off by 0.89 of the margin.

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/ground/recent.h"
#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::ground {

inline constexpr int kLevels = 7;                               // cells of 1/4 m to 1,024 m
inline constexpr int kCellsBits = 2, kCells = 1 << kCellsBits;  // along a square's side
inline constexpr int kFinestCellBits = 6;                       // steps
inline constexpr int kMaxKept = 100'000;                        // squares of one generation: 28 MiB
inline constexpr int kMaxKeptRises = 4'096;                     // of one edited terrain
inline constexpr int kWidestWithEdits = 4;                      // level: looking at all edits of a wider square takes too long

constexpr int cellBits(int level) { return kFinestCellBits + 2 * level; }
constexpr double cellMetres(int level) { return static_cast<double>(lattice::Step{1} << cellBits(level)) * lattice::kMetresPerStep; }

// A bound that comes down when all cells within turn out to be lower. A ray that passes above these is not stopped by them either: it meets
// the same before and after.
class Lowered {
 public:
  Lowered(float metres = 0) : metres_(metres) {}
  Lowered(const Lowered& other) : metres_(other.metres()) {}
  Lowered& operator=(const Lowered& other) { return metres_.store(other.metres(), std::memory_order_relaxed), *this; }
  float metres() const { return metres_.load(std::memory_order_relaxed); }
  void lower(float metres) const {
    if (metres < this->metres()) metres_.store(metres, std::memory_order_relaxed);
  }

 private:
  mutable std::atomic<float> metres_;
};

struct Bounds {
  std::array<float, (kCells + 1) * (kCells + 1)> corner{};  // metres, along x first; up to coarsestWithCorners()
  std::array<float, kCells * kCells> high{};                // metres; where there are corners, the highest of the cell's and the margin
  std::array<Lowered, kCells * kCells> lowered{};           // at most that
  float highest = 0;                                        // of `high`
};

// What edits add to a square's heights, metres.
struct Rises {
  float lowest = 0, highest = 0;
};

// The bounds of one terrain, for one thread at a time. They live as long as this.
class Reader {
 public:
  explicit Reader(const terrain::Terrain& terrain);
  const Bounds& bounds(const Square& square);
  Rises rises(const Square& square);
  bool isMap() const { return isMap_; }
  int coarsestWithCorners() const { return coarsestWithCorners_; }  // level: those of a map's wider squares do not follow its ground
  double finestOfMap() const { return finestOfMap_; }               // metres between its samples
  int widest() const { return edits_ ? kWidestWithEdits : kLevels - 1; }
  double highest() const { return highest_; }  // no ground is higher
  std::uint64_t heights() const { return heights_; }

 private:
  Bounds ofOctaves(const Square& square);
  Bounds ofMap(const Square& square);

  const terrain::Terrain& ground_;  // without edits
  const terrain::Raster* const edits_;
  const bool isMap_;
  int coarsestWithCorners_ = kLevels - 1;
  double finestOfMap_ = 0;
  double highest_;
  Recent<Bounds>::Reader kept_;
  std::optional<Recent<Rises>::Reader> keptRises_;
  std::uint64_t heights_ = 0;
};

}  // namespace ridgecast::ground
