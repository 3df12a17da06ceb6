#pragma once
// A square of a terrain with ramps for steps: between the points of a grid the ground is bilinear. A step that a mesh cannot follow, such
// as a cliff whose two sides are neighbours on the lattice, becomes a slope as wide as the grid's spacing.
//
// Heights are asked for once, 512 along a side; the grid is a part of them, 128 along a side at first. Immutable except for widen();
// otherwise any thread, like the terrain.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/lattice/lattice.h"
#include "common/terrain/terrain.h"

namespace ridgecast::tileset {

class Ramps final : public terrain::Terrain {
 public:
  Ramps(const terrain::Terrain& terrain, lattice::LeafAddress square);

  bool widen();          // to twice the width; false: they are as wide as the square
  double width() const;  // metres

  // How far the ground is from the terrain over low..high, in metres and by the heights asked for: at most `apart`, or else by the whole
  // difference of height within the ramp.
  double apartFrom(lattice::Point low, lattice::Point high, double apart) const;

  std::string_view name() const override { return terrain_.name(); }
  std::string_view source() const override { return terrain_.source(); }
  std::uint32_t seed() const override { return terrain_.seed(); }
  // Beyond the square: those of its border.
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override;

 private:
  static constexpr int kHeightBits = 9, kGridBits = 7;
  static constexpr std::int32_t kHeights = 1 << kHeightBits;  // along a side, and one more
  float at(std::int32_t i, std::int32_t j) const {
    return height_[static_cast<std::size_t>(j) * (kHeights + 1) + static_cast<std::size_t>(i)];
  }
  // Of the cell from (i, j); u, v: 0..1 within it.
  double between(std::int32_t i, std::int32_t j, double u, double v) const;

  const terrain::Terrain& terrain_;
  const lattice::LeafAddress square_;
  int bits_ = kHeightBits - kGridBits;  // heights between the grid's points, as a power of two
  std::vector<float> height_;           // along x first
};

}  // namespace ridgecast::tileset
