// Where a triangle is farthest from its samples, in floats: nothing is proven by it.
#include <algorithm>
#include <array>
#include <bit>

#include "server/box/judge.h"
#include "server/box/shape.h"
#include "server/box/vectors.h"

namespace ridgecast::box {

using triangulation::Point2;

namespace {

// Rows are as far apart as on a square grid with so many samples in the triangle, about, at most; of each row all are looked at.
constexpr std::int64_t kGlance = 200;
constexpr float kBeside = 1e-4f;  // of a spacing: what counts as on an edge

// The sides of a triangle across the rows of a grid: two of them begin a row, two end it, of which one may stand there twice.
struct Sides {
  std::array<float, 4> x, z, slope;  // a corner; along x for each unit along z
};

// A triangle and a tile's samples, in spacings from the tile's corner, of which rows `stride` apart are looked at, from top to bottom.
struct Scan {
  const float* height;
  std::int32_t across;  // heights from row to row
  std::int32_t stride, top, bottom, left, right;
  Sides sides;
  double base, down;  // the triangle's plane: metres at the corner, a spacing
  float along;
};
struct Farthest {
  float off;
  std::int32_t column, row;  // negative: no sample is farther off than was known
};

RIDGECAST_VECTOR_CLONES Farthest scanned(const Scan& scan, float off) {
  const Floats zero{};
  const Sides& side = scan.sides;
  const auto left = static_cast<float>(scan.left), right = static_cast<float>(scan.right);
  Floats most = zero + off;
  Ints where = kNext * 0 - 1;
  for (std::int32_t top = scan.top; top <= scan.bottom; top += kLanes * scan.stride) {
    const Floats row = __builtin_convertvector(top + kNext * scan.stride, Floats);
    std::array<Floats, 4> on;
    for (std::size_t k = 0; k < on.size(); ++k) on[k] = (row - side.z[k]) * side.slope[k] + side.x[k];
    Floats begin = on[0] > on[1] ? on[0] : on[1], end = on[2] < on[3] ? on[2] : on[3];
    begin = begin > left ? begin : zero + left;
    begin = begin < right + 1 ? begin : zero + (right + 1);
    end = end < right ? end : zero + right;
    end = end > left - 1 ? end : zero + (left - 1);
    std::array<std::int32_t, kLanes> from, to;
    std::array<float, kLanes> base;
    const Ints first = __builtin_convertvector(begin + (1 - kBeside), Ints), last = __builtin_convertvector(end + (1 + kBeside), Ints) - 1;
    const Floats level = __builtin_convertvector(scan.base + scan.down * __builtin_convertvector(row, Doubles), Floats);
    store(first, from.data());
    store(last, to.data());
    store(level, base.data());
    for (std::size_t k = 0; k < from.size(); ++k) {
      const std::int32_t j = top + static_cast<std::int32_t>(k) * scan.stride;
      if (j > scan.bottom) break;
      const float* const height = scan.height + j * scan.across;
      for (std::int32_t n = from[k]; n <= to[k]; n += kLanes) {
        Floats h;
        load(h, height + n);
        const Ints column = n + kNext;
        const Floats miss = h - (base[k] + __builtin_convertvector(column, Floats) * scan.along), far = miss > zero ? miss : -miss;
        const Ints better = (far > most) & (column <= to[k]);
        most = better ? far : most;
        where = better ? column + (j << 16) : where;
      }
    }
  }
  Farthest found{off, 0, -1};
  std::int32_t at = -1;
  for (std::int32_t lane = 0; lane < kLanes; ++lane)
    if (where[lane] >= 0 && (most[lane] > found.off || (most[lane] == found.off && where[lane] < at))) {
      found.off = most[lane];
      at = where[lane];
    }
  if (at >= 0) found = {found.off, at & 0xffff, at >> 16};
  return found;
}

struct Edges {  // numbers of edges, as in Sides
  std::array<std::size_t, 4> side;
  std::array<float, 4> slope;
};
Edges edgesOf(const Shape& shape) {
  Edges edges{};
  std::size_t begins = 0, ends = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    if (shape.dz[k] > 0) {
      edges.side[1] = k;
      if (begins++ == 0) edges.side[0] = k;
    }
    if (shape.dz[k] < 0) {
      edges.side[3] = k;
      if (ends++ == 0) edges.side[2] = k;
    }
  }
  for (std::size_t k = 0; k < 4; ++k)
    edges.slope[k] = static_cast<float>(shape.dx[edges.side[k]]) / static_cast<float>(shape.dz[edges.side[k]]);
  return edges;
}

}  // namespace

Worst Judge::glance(const Corners& corners) const {
  const Shape shape(corners);
  const auto wanted = static_cast<std::uint64_t>(shape.twiceArea() / (2 * kGlance));
  const int atLeast = static_cast<int>(std::bit_width(wanted) + 1) / 2;  // bits between rows
  const Edges edges = edgesOf(shape);
  const Point2 from{std::max(shape.low.x, low_.x + 1), std::max(shape.low.z, low_.z + 1)},
      to{std::min(shape.high.x, high_.x - 1), std::min(shape.high.z, high_.z - 1)};
  Worst worst{0, 0, 0, false};
  const auto scan = [&](std::size_t number) {
    const Tile& tile = samples_[number];
    // The tile's last samples are the next one's first.
    const std::int32_t last = tile.cells() - 1, stride = 1 << std::clamp(atLeast - tile.bits, 0, tile.cellBits);
    const auto onward = [&](std::int32_t v, std::int32_t apart) { return (apart - 1 - (-v >> tile.bits)) & -apart; };
    Scan rows{.height = tile.height,
              .across = tile.across(),
              .stride = stride,
              .top = std::max(0, onward(from.z - tile.corner.z, stride)),
              .bottom = std::min(last, (to.z - tile.corner.z) >> tile.bits),
              .left = std::max(0, onward(from.x - tile.corner.x, 1)),
              .right = std::min(last, (to.x - tile.corner.x) >> tile.bits),
              .sides = {.x = {}, .z = {}, .slope = edges.slope},
              .base = shape.at(tile.corner.x, tile.corner.z),
              .down = shape.gz * tile.spacing(),
              .along = static_cast<float>(shape.gx * tile.spacing())};
    if (rows.top > rows.bottom || rows.left > rows.right) return;
    const auto share = static_cast<float>(1 / tile.spacing());
    for (std::size_t k = 0; k < 4; ++k) {
      const Point2 p = shape.corner[edges.side[k]];
      rows.sides.x[k] = static_cast<float>(p.x - tile.corner.x) * share;
      rows.sides.z[k] = static_cast<float>(p.z - tile.corner.z) * share;
    }
    const Farthest found = scanned(rows, worst.error);
    if (found.row < 0) return;
    worst = {found.off, tile.corner.x + (found.column << tile.bits), tile.corner.z + (found.row << tile.bits), false};
  };
  samples_.forEach(from, to, scan, std::max(0, atLeast - samples_[0].bits - Samples::kCellBits));
  worst.admissible = worst.error > 0 && shape.holds(worst.at());
  return worst;
}

}  // namespace ridgecast::box
