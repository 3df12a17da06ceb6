#pragma once
// Internal to the room: the cells of a tile that a triangle meets, and which of them may be too far from its plane.

#include <array>
#include <cstdint>

#include "server/box/samples.h"
#include "server/box/shape.h"
#include "server/box/vectors.h"

namespace ridgecast::box {

inline constexpr float kNear = 4e-6f;  // of a spacing: the resolution of floats in a tile

// Of a triangle on lines of a grid, in spacings; none: from > to.
struct Parts {
  static constexpr std::size_t kLines = (1 << Samples::kCellBits) + 1;

  std::array<float, kLines + 2 * kLanes> from, to;  // a few more are written

  // Of `count` lines from the first on, those within low..high.
  void cross(const Lines& lines, std::int32_t first, std::int32_t count, std::int32_t low, std::int32_t high);
};

// Without initialisers: most of it is never touched.
struct Cells {
  static constexpr std::size_t kAcross = (1 << Samples::kCellBits) + 1;

  const Tile* tile;
  std::int32_t i0, j0, i1, j1;
  std::array<float, 3> u, v;  // the triangle's corners, in spacings
  double base, down;          // its plane: metres at the first cell's corner, a row
  float along;                // and a column
  Parts rows;                 // of the triangle, from line j0 on; crossed before judge()
  // Filled by judge():
  std::array<float, Parts::kLines * kAcross> off;     // of the samples from the plane, metres, along x first; from row j0 on
  std::array<std::uint32_t, kAcross - 1> suspicious;  // by column: a bit for each row, from j0 on
  float passed;                                       // metres: the maximum of all other cells, slack included

  static std::size_t place(std::int32_t i, std::int32_t k) { return static_cast<std::size_t>(k) * kAcross + static_cast<std::size_t>(i); }
  const float& offAt(std::int32_t i, std::int32_t j) const { return off[place(i, j - j0)]; }
  // A cell whose four corners are off by at most `error`, slack included, passes as a whole.
  void judge(float error);
};

}  // namespace ridgecast::box
