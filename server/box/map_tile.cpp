#include "server/box/map_tile.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace ridgecast::box {

using lattice::Step;

namespace {

// The tile's samples along one axis, among the posts around them.
struct Axis {
  struct Cell {
    std::size_t first, last;  // intervals between posts that it meets, counted as the posts before them
    float from, to;           // in the first, if it is the last
    bool operator==(const Cell& o) const { return first == o.first && last == o.last; }
  };
  std::int64_t zero;                 // the first post's number
  std::vector<std::size_t> before;   // by sample: the post before it, counted from the first
  std::vector<std::int32_t> beyond;  // steps from that post to it
  std::vector<Cell> cells;

  void place(Step at, Step spacing, std::size_t samples, Step origin, std::uint32_t pitch) {
    zero = terrain::between(at, origin, pitch).sample - 1;
    before.resize(samples);
    beyond.resize(samples);
    for (std::size_t k = 0; k < samples; ++k) {
      const terrain::Between found = terrain::between(at + static_cast<Step>(k) * spacing, origin, pitch);
      before[k] = static_cast<std::size_t>(found.sample - zero);
      beyond[k] = found.steps;
    }
    cells.resize(samples - 1);
    const auto share = [&](std::int32_t steps) { return static_cast<float>(steps) / static_cast<float>(pitch); };
    for (std::size_t k = 0; k + 1 < samples; ++k)
      cells[k] = beyond[k + 1] > 0 ? Cell{before[k], before[k + 1], share(beyond[k]), share(beyond[k + 1])}
                                   : Cell{before[k], before[k + 1] - 1, share(beyond[k]), 1};
  }
  std::size_t posts() const { return before.back() + 3; }
};

// Along a row of posts a, b, c, d the bicubic (Catmull-Rom) is a cubic between b and c whose second derivative runs straight from
// P = 2 a - 5 b + 4 c - d to Q = 2 d - 5 c + 4 b - a. From p to q on a part of width w, it is off the chord by w^2 t (1 - t) / 6 *
// (p (2 - t) + q (1 + t)), at most w^2 (|p + q| / 16 + |p - q| / 124): below it where p and q are positive, above it where they are
// negative, so both are bounded by themselves. Here of a cell, along the line of posts that begins at `line`, in steps for w = 1.
Slack bend(const Axis::Cell& cell, const std::int32_t* line, std::size_t apart) {
  Slack most;
  for (std::size_t k = cell.first; k <= cell.last; ++k) {
    const std::int32_t* const post = line + (k - 1) * apart;
    const auto a = static_cast<float>(post[0]), b = static_cast<float>(post[apart]), c = static_cast<float>(post[2 * apart]),
               d = static_cast<float>(post[3 * apart]);
    const float p = 2 * a - 5 * b + 4 * c - d, q = 2 * d - 5 * c + 4 * b - a;
    if (cell.first != cell.last) {
      most = {std::max({most.below, p / 8, q / 8}), std::max({most.above, -p / 8, -q / 8})};
      continue;
    }
    const float u = p + (q - p) * cell.from, v = p + (q - p) * cell.to;
    const auto off = [](float begin, float end) {
      begin = std::max(begin, 0.0f), end = std::max(end, 0.0f);
      return (begin + end) / 16 + std::abs(begin - end) / 124;
    };
    most = {off(u, v), off(-u, -v)};
  }
  return most;
}

// Across, four rows are blended with weights of which the middle two sum to at most 9/8 and the outer two, which are negative, to 1/8.
// `along` begins with the first row's, for one cell along it.
Slack blended(const Slack* along, std::size_t apart, const Axis::Cell& across) {
  Slack middle, outer;
  const auto widen = [&](Slack& slack, std::size_t row) {
    const Slack& at = along[row * apart];
    slack = {std::max(slack.below, at.below), std::max(slack.above, at.above)};
  };
  for (std::size_t n = across.first; n <= across.last; ++n) {
    widen(middle, n);
    widen(middle, n + 1);
    widen(outer, n - 1);
    widen(outer, n + 2);
  }
  return {1.125f * middle.below + 0.125f * outer.above, 1.125f * middle.above + 0.125f * outer.below};
}

// Off the bilinear surface it is by no more than the sum of both directions.
void prove(const Axis& x, const Axis& z, const std::vector<std::int32_t>& posts, float scale, Tile& tile) {
  const std::size_t columns = x.posts(), rows = z.posts(), cells = static_cast<std::size_t>(tile.cells());
  // By line of posts and cell.
  thread_local std::vector<Slack> alongX, alongZ;
  alongX.resize(rows * cells);
  alongZ.resize(columns * cells);
  for (std::size_t j = 0; j < rows; ++j)
    for (std::size_t k = 0; k < cells; ++k) alongX[j * cells + k] = bend(x.cells[k], &posts[j * columns], 1);
  for (std::size_t i = 0; i < columns; ++i)
    for (std::size_t k = 0; k < cells; ++k) alongZ[i * cells + k] = bend(z.cells[k], &posts[i], columns);
  tile.slack.resize(cells * cells);
  // Cells between the same posts have the same rows of posts.
  const auto same = [](const Axis& axis, std::size_t cell) { return cell > 0 && axis.cells[cell] == axis.cells[cell - 1]; };
  thread_local std::vector<Slack> first;
  first.resize(cells);
  for (std::size_t j = 0; j < cells; ++j) {
    Slack second;
    for (std::size_t i = 0; i < cells; ++i) {
      if (!same(z, j)) first[i] = blended(&alongX[i], cells, z.cells[j]);
      if (!same(x, i)) second = blended(&alongZ[j], cells, x.cells[i]);
      tile.slack[j * cells + i] = {scale * (first[i].below + second.below), scale * (first[i].above + second.above)};
    }
  }
}

// The posts around a tile, which may be a few more than a map gives at a time.
void fetch(const terrain::Raster& map, const Axis& x, const Axis& z, std::vector<std::int32_t>& posts) {
  constexpr std::size_t most = terrain::kTileSide;
  posts.resize(x.posts() * z.posts());
  thread_local std::vector<std::int32_t> part;
  for (std::size_t j = 0; j < z.posts(); j += most)
    for (std::size_t i = 0; i < x.posts(); i += most) {
      const std::size_t columns = std::min(most, x.posts() - i), rows = std::min(most, z.posts() - j);
      part.resize(columns * rows);
      map.samples(x.zero + static_cast<std::int64_t>(i), z.zero + static_cast<std::int64_t>(j), static_cast<std::int32_t>(columns),
                  static_cast<std::int32_t>(rows), part.data());
      for (std::size_t row = 0; row < rows; ++row) std::copy_n(&part[row * columns], columns, &posts[(j + row) * x.posts() + i]);
    }
}

}  // namespace

void sampleMap(const terrain::Raster& map, const Frame& frame, Tile& tile) {
  const terrain::RasterShape& shape = map.shape();
  const Step spacing = Step{1} << (tile.bits + frame.unitBits);
  const lattice::Point corner = frame.global(tile.corner);
  const auto across = static_cast<std::size_t>(tile.across());
  thread_local Axis x, z;
  x.place(corner.x, spacing, across, shape.originX, shape.pitch);
  z.place(corner.z, spacing, across, shape.originZ, shape.pitch);
  thread_local std::vector<std::int32_t> posts;
  fetch(map, x, z, posts);
  std::array<std::int32_t, 16> around;
  terrain::CubicPlaces places;
  tile.height.resize(tile.count());
  for (std::size_t j = 0; j < across; ++j)
    for (std::size_t begin = 0; begin < across; begin += terrain::CubicPlaces::kMost) {
      const std::size_t count = std::min<std::size_t>(across - begin, terrain::CubicPlaces::kMost);
      for (std::size_t k = 0; k < count; ++k) {
        const std::size_t i = begin + k;
        const std::int32_t* const first = &posts[(z.before[j] - 1) * x.posts() + x.before[i] - 1];
        for (std::size_t row = 0; row < 4; ++row) std::copy_n(first + row * x.posts(), 4, &around[4 * row]);
        places.set(k, around, x.beyond[i], z.beyond[j]);
      }
      terrain::cubicHeights(places, static_cast<int>(count), shape.pitch, &tile.height[j * across + begin]);
    }
  if (spacing == 1) return;  // every point of the lattice
  tile.slackBits = 0;
  const double share = static_cast<double>(spacing) / shape.pitch;
  prove(x, z, posts, static_cast<float>(share * share * lattice::kMetresPerStep), tile);
}

void addEdits(const terrain::Raster& edits, const Frame& frame, Tile& tile) {
  const terrain::RasterShape& shape = edits.shape();
  const Step spacing = Step{1} << (tile.bits + frame.unitBits), pitch = shape.pitch;
  const lattice::Point corner = frame.global(tile.corner);
  // Of the posts that a square of `side` steps reads, by how much the curve between them may leave one another at most.
  const auto swing = [&](Step x, Step z, Step side) {
    const std::int64_t a = terrain::between(x, shape.originX, shape.pitch).sample - 1,
                       b = terrain::between(z, shape.originZ, shape.pitch).sample - 1;
    const std::int64_t posts = side / pitch + 4;
    const terrain::Raster::Range range = edits.range(a, b, posts, posts);
    return static_cast<float>(1.575 * (static_cast<double>(range.highest) - range.lowest) * lattice::kMetresPerStep);
  };
  const Step side = spacing << tile.cellBits;
  if (swing(corner.x, corner.z, side) == 0) return;
  const int blockSide = 1 << Tile::kBlockBits;
  Tile rise(tile.corner, tile.bits, tile.cellBits);
  const bool looks = spacing <= kPostsACell * pitch;
  if (looks) sampleMap(edits, frame, rise);
  for (int j = 0; j < tile.blocks(); ++j)
    for (int i = 0; i < tile.blocks(); ++i) {
      Slack most;
      if (looks) {
        for (int row = j * blockSide; row < (j + 1) * blockSide; ++row)
          for (int column = i * blockSide; column < (i + 1) * blockSide; ++column) {
            const Slack cell = rise.slackOf(column, row);
            most = {std::max(most.below, cell.below), std::max(most.above, cell.above)};
          }
      } else {
        most.below = most.above = swing(corner.x + (Step{i} << Tile::kBlockBits) * spacing,
                                        corner.z + (Step{j} << Tile::kBlockBits) * spacing, spacing << Tile::kBlockBits);
      }
      Slack& slack = tile.slack[tile.block(i, j)];
      slack = {slack.below + most.below, slack.above + most.above};
    }
}

}  // namespace ridgecast::box
