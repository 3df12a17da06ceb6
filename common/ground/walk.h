#pragma once
// Internal to the room: one ray on its way over the bounds of the ground.

#include <algorithm>
#include <array>
#include <cstdint>

#include "common/ground/bounds.h"
#include "common/ground/ground.h"

namespace ridgecast::ground {

inline constexpr int kCoarsestOfOctaves = 2;  // the level of the widest cells where the ground itself is asked

// A stretch of a ray over one cell where it may meet the ground.
struct Stretch {
  double from = 0, to = 0;  // metres along the ray; above the ground at `from`
  double bend = 0;          // of the ground's profile: at most so far, metres, from a chord over `side`, in proportion for shorter ones
  double side = 0;          // metres
  double steep = 0;         // of what edits add: at most so far from a chord, metres a metre of it
  double guess = -1;        // where it meets a surface near the ground; negative: nowhere
  double slope = 0;         // at which, metres a metre
};

// The squares last visited, one of each level.
class Near {
 public:
  explicit Near(Reader& reader) : reader_(reader) {}
  struct Entry {
    Square square;
    const Bounds* bounds = nullptr;
    Rises rises;
    // Of the bounds that rays meet on the way here, wherever they come from: those of cells that may be the finest are not lowered.
    float highest() const {
      if (square.level <= kCoarsestOfOctaves) return bounds->highest;
      float most = bounds->lowered[0].metres();
      for (const Lowered& bound : bounds->lowered) most = std::max(most, bound.metres());
      return most;
    }
  };
  const Entry& at(const Square& square) {
    Entry& entry = entries_[static_cast<std::size_t>(square.level)];
    if (entry.square != square || !entry.bounds) entry = {square, &reader_.bounds(square), reader_.rises(square)};
    return entry;
  }
  const Reader& reader() const { return reader_; }

 private:
  Reader& reader_;
  std::array<Entry, kLevels> entries_;
};

class Walk {
 public:
  Walk() = default;
  Walk(const Ray& ray, const Reader& reader);
  // The next stretch from where the last one ended. False: the ray ends above the ground.
  bool next(Near& near, Stretch& out);
  double above(double t, float ground) const { return y_ + dy_ * t - ground; }
  lattice::Point at(double t) const;
  double spacing(double t) const { return t > 256 ? t / 16'384 : 1.0 / 64; }  // of samples that nothing is missed between

 private:
  bool inCell(const Near::Entry& entry, double leaves, const Reader& reader, Stretch& out);
  void turnTo(int level, std::int64_t i, std::int64_t j);
  void step();
  void descend();
  std::size_t slot() const { return static_cast<std::size_t>((j_ & (kCells - 1)) * kCells + (i_ & (kCells - 1))); }  // in its square
  bool alongX() const { return leavesX_ <= leavesZ_; }
  double leaves() const { return std::max(std::min(leavesX_, leavesZ_), t_); }  // the cell

  lattice::Step x_ = 0, z_ = 0;  // the ray's beginning
  double y_ = 0;
  double dx_ = 0, dy_ = 0, dz_ = 0;  // the direction; dx_ and dz_ in steps a metre
  double perX_ = 0, perZ_ = 0;       // metres a step; infinite: never
  double t_ = 0, end_ = -1;          // metres along the ray: where it is, where it ends
  int level_ = 0, widest_ = 0;
  std::int64_t i_ = 0, j_ = 0;  // the cell
  double leavesX_ = 0, leavesZ_ = 0;
};

}  // namespace ridgecast::ground
