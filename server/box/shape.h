#pragma once
// Internal to the room: a triangle as its judge sees it.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "common/lattice/lattice.h"
#include "common/triangulation/predicates.h"
#include "server/box/judge.h"

namespace ridgecast::box {

// Where the triangle begins and ends on the parallel lines of a grid, in spacings from the grid's corner. A side's function, positive
// inside, is a whole number below 2^53 at the grid's points, so only the last multiplication rounds.
struct Lines {
  std::array<double, 3> at, by, per;  // the sides' functions on line 0; their increase per line; spacings per unit of theirs
  std::array<double, 3> from, to;     // 0, or unbounded where the side is not a lower or not an upper end
};

// The triangle, starting at its smallest corner, so that nothing depends on how it was made.
struct Shape {
  std::array<triangulation::Point2, 3> corner;
  std::array<std::int64_t, 3> dx, dz;  // of the edges, from corner k to the next
  triangulation::Point2 low, high;
  std::array<double, 3> height;  // of the corners, metres
  double gx, gz;                 // the plane: metres a unit

  explicit Shape(const Corners& v) {
    std::size_t first = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (triangulation::smaller(v[k].at, v[first].at)) first = k;
    for (std::size_t k = 0; k < 3; ++k) {
      corner[k] = v[(first + k) % 3].at;
      height[k] = v[(first + k) % 3].y * lattice::kMetresPerStep;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      dx[k] = std::int64_t{corner[(k + 1) % 3].x} - corner[k].x;
      dz[k] = std::int64_t{corner[(k + 1) % 3].z} - corner[k].z;
    }
    low = {std::min({corner[0].x, corner[1].x, corner[2].x}), std::min({corner[0].z, corner[1].z, corner[2].z})};
    high = {std::max({corner[0].x, corner[1].x, corner[2].x}), std::max({corner[0].z, corner[1].z, corner[2].z})};
    const double area = static_cast<double>(twiceArea()), up = height[1] - height[0], over = height[2] - height[0];
    gx = (static_cast<double>(dz[0]) * over + static_cast<double>(dz[2]) * up) / area;
    gz = -(static_cast<double>(dx[0]) * over + static_cast<double>(dx[2]) * up) / area;
  }
  std::int64_t twiceArea() const { return triangulation::orientation(corner[0], corner[1], corner[2]); }
  double at(double x, double z) const { return height[0] + gx * (x - corner[0].x) + gz * (z - corner[0].z); }
  bool holds(triangulation::Point2 p) const {
    return triangulation::holds(corner[0], corner[1], corner[2], p) && p != corner[0] && p != corner[1] && p != corner[2];
  }
  // Side k's function: positive on the triangle's side of it.
  std::int64_t inside(std::size_t k, std::int32_t x, std::int32_t z) const {
    return dz[k] * (std::int64_t{x} - corner[k].x) - dx[k] * (std::int64_t{z} - corner[k].z);
  }
  // Whether the triangle has no part strictly inside low..high, by its sides.
  bool misses(triangulation::Point2 from, triangulation::Point2 to) const {
    for (std::size_t k = 0; k < 3; ++k)
      if (inside(k, dz[k] > 0 ? to.x : from.x, dx[k] > 0 ? from.z : to.z) <= 0) return true;
    return false;
  }
  // For a grid with points `spacing` units apart, a power of two, along x (from its corner's z on) or along z.
  Lines lines(triangulation::Point2 grid, double spacing, bool alongX) const {
    Lines lines;
    const double share = 1 / spacing;
    for (std::size_t k = 0; k < 3; ++k) {
      const double along = alongX ? static_cast<double>(dz[k]) : -static_cast<double>(dx[k]);
      lines.at[k] = static_cast<double>(inside(k, grid.x, grid.z));
      lines.by[k] = (alongX ? -static_cast<double>(dx[k]) : static_cast<double>(dz[k])) * spacing;
      lines.per[k] = along == 0 ? 0 : -1 / along * share;
      lines.from[k] = along > 0 ? 0 : -1e30;
      lines.to[k] = along < 0 ? 0 : 1e30;
    }
    return lines;
  }
  // Along an edge, a bilinear cell is a parabola: beyond its ends in the cell by at most this times the cell's twist.
  float bulge(double spacing) const {
    const double share = 1 / (spacing * spacing);
    double most = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto x = std::abs(static_cast<double>(dx[k])), z = std::abs(static_cast<double>(dz[k]));
      most = std::max(most, std::min(std::min(x, z) / std::max(x, z), x * z * share));
    }
    return static_cast<float>(most / 4);
  }
};

}  // namespace ridgecast::box
