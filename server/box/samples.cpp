#include "server/box/samples.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/terrain/raster.h"

namespace ridgecast::box {

using lattice::Step;
using triangulation::Point2;

namespace {

constexpr float kMargin = 3;    // of measured curvature, for what a finer grid would find
constexpr int kPostsACell = 4;  // of a map, along a side: more take too long to look at

}  // namespace

Samples::Samples(const terrain::Terrain& terrain, const Frame& frame, Point2 low, Point2 high, int bits)
    : terrain_(terrain), map_(terrain.raster()), frame_(frame), bits_(bits) {
  const int shift = bits + kCellBits;
  first_ = {(low.x >> shift) << shift, (low.z >> shift) << shift};
  across_ = ((high.x - first_.x) >> shift) + 1;
  down_ = ((high.z - first_.z) >> shift) + 1;
  for (std::int32_t j = 0; j < down_; ++j)
    for (std::int32_t i = 0; i < across_; ++i) add({first_.x + (i << shift), first_.z + (j << shift)}, bits, kCellBits);
}

void Samples::add(Point2 corner, int bits, int cellBits) {
  tiles_.push_back(std::make_unique<Tile>(Tile{.corner = corner, .bits = bits, .cellBits = cellBits}));
  count_ += tiles_.back()->count();
}

void Samples::refine(const Block& at) {
  Tile& tile = *tiles_[at.tile];
  if (tile.finer.empty()) tile.finer.assign(static_cast<std::size_t>(tile.blocks()) * static_cast<std::size_t>(tile.blocks()), -1);
  tile.finer[at.block] = static_cast<std::int32_t>(tiles_.size());
  const auto i = static_cast<std::int32_t>(at.block) % tile.blocks(), j = static_cast<std::int32_t>(at.block) / tile.blocks();
  const int shift = tile.bits + Tile::kBlockBits;
  add({tile.corner.x + (i << shift), tile.corner.z + (j << shift)}, tile.bits - 1, Tile::kBlockBits + 1);
}

bool Samples::proves() const { return map_ && spacing() <= kPostsACell * map_->shape().pitch; }

void Samples::fill(std::size_t number) {
  Tile& tile = *tiles_[number];
  const int across = tile.across();
  const std::size_t size = tile.count();
  thread_local std::vector<Step> x, z;
  x.resize(size);
  z.resize(size);
  tile.height.resize(size);
  tile.slack.assign(static_cast<std::size_t>(tile.blocks()) * static_cast<std::size_t>(tile.blocks()), 0.0f);
  const lattice::Point corner = frame_.global(tile.corner);
  const int shift = tile.bits + frame_.unitBits;
  for (int j = 0; j < across; ++j)
    for (int i = 0; i < across; ++i) {
      x[tile.index(i, j)] = corner.x + (Step{i} << shift);
      z[tile.index(i, j)] = corner.z + (Step{j} << shift);
    }
  terrain_.heights(x, z, tile.height);
  if (shift == 0) return;  // every point of the lattice
  if (proves())
    prove(tile);
  else
    measure(tile);
  tile.most = *std::ranges::max_element(tile.slack);
}

void Samples::measure(Tile& tile) const {
  const int across = tile.across(), cells = tile.cells(), side = 1 << Tile::kBlockBits;
  thread_local std::vector<float> bend;
  bend.resize(tile.count());
  for (int j = 0; j < across; ++j)
    for (int i = 0; i < across; ++i) {
      const int a = std::clamp(i, 1, cells - 1), b = std::clamp(j, 1, cells - 1);
      const auto h = [&](int p, int q) { return tile.height[tile.index(a + p, b + q)]; };
      bend[tile.index(i, j)] = std::abs(h(-1, 0) - 2 * h(0, 0) + h(1, 0)) + std::abs(h(0, -1) - 2 * h(0, 0) + h(0, 1));
    }
  for (int j = 0; j < tile.blocks(); ++j)
    for (int i = 0; i < tile.blocks(); ++i) {
      float most = 0;
      for (int row = j * side; row <= (j + 1) * side; ++row)
        for (int column = i * side; column <= (i + 1) * side; ++column) most = std::max(most, bend[tile.index(column, row)]);
      tile.slack[tile.block(i, j)] = kMargin / 8 * most;
    }
}

// Along a row of posts a, b, c, d the bicubic (Catmull-Rom) is a cubic between b and c whose second derivative runs straight from
// P = 2 a - 5 b + 4 c - d to Q = 2 d - 5 c + 4 b - a. From p to q on a part of width w, it is off the chord by w^2 t (1 - t) / 6 *
// (p (2 - t) + q (1 + t)), at most w^2 (|p + q| / 16 + |p - q| / 124). Across, four rows are blended with weights of which the middle two
// sum to at most 9/8 and the outer two to 1/8. Off the bilinear surface it is by no more than the sum of both directions.
void Samples::prove(Tile& tile) const {
  const terrain::RasterShape& shape = map_->shape();
  const Step side = Step{1} << (tile.bits + frame_.unitBits);
  const lattice::Point corner = frame_.global(tile.corner);
  const auto cells = static_cast<std::size_t>(tile.cells());
  // The posts around a cell along one axis, and where in their interval it lies.
  struct Span {
    std::size_t first, last;  // intervals
    float from, to;           // in the first, if it is the last
  };
  thread_local std::vector<Span> spanX, spanZ;
  const auto place = [&](Step at, Step origin, std::int64_t& zero, std::vector<Span>& spans) {
    zero = terrain::between(at, origin, shape.pitch).sample - 1;
    spans.resize(cells);
    for (std::size_t k = 0; k < cells; ++k) {
      const Step begin = at + static_cast<Step>(k) * side;
      const terrain::Between from = terrain::between(begin, origin, shape.pitch),
                             to = terrain::between(begin + side - 1, origin, shape.pitch);
      const auto share = [&](std::int32_t steps) { return static_cast<float>(steps) / static_cast<float>(shape.pitch); };
      spans[k] = {static_cast<std::size_t>(from.sample - zero), static_cast<std::size_t>(to.sample - zero), share(from.steps),
                  share(to.steps + 1)};
    }
    return spans.back().last + 3;  // posts
  };
  std::int64_t zeroX, zeroZ;
  const std::size_t columns = place(corner.x, shape.originX, zeroX, spanX), rows = place(corner.z, shape.originZ, zeroZ, spanZ);
  thread_local std::vector<std::int32_t> posts;
  posts.resize(columns * rows);
  map_->samples(zeroX, zeroZ, static_cast<std::int32_t>(columns), static_cast<std::int32_t>(rows), posts.data());
  const double share = static_cast<double>(side) / shape.pitch;
  const auto scale = static_cast<float>(share * share * lattice::kMetresPerStep);
  // Of a cell's span, along a line of posts that begins at `line`.
  const auto bend = [&](const Span& span, std::size_t line, std::size_t apart) {
    float most = 0;
    for (std::size_t k = span.first; k <= span.last; ++k) {
      const std::int32_t* const post = &posts[line + (k - 1) * apart];
      const auto a = static_cast<float>(post[0]), b = static_cast<float>(post[apart]), c = static_cast<float>(post[2 * apart]),
                 d = static_cast<float>(post[3 * apart]);
      const float p = 2 * a - 5 * b + 4 * c - d, q = 2 * d - 5 * c + 4 * b - a;
      if (span.first != span.last) {
        most = std::max({most, std::abs(p) / 8, std::abs(q) / 8});
        continue;
      }
      const float u = p + (q - p) * span.from, v = p + (q - p) * span.to;
      most = std::abs(u + v) / 16 + std::abs(u - v) / 124;
    }
    return most * scale;
  };
  // By line of posts and cell.
  thread_local std::vector<float> alongX, alongZ;
  alongX.resize(rows * cells);
  alongZ.resize(columns * cells);
  for (std::size_t j = 0; j < rows; ++j)
    for (std::size_t k = 0; k < cells; ++k) alongX[j * cells + k] = bend(spanX[k], j * columns, 1);
  for (std::size_t i = 0; i < columns; ++i)
    for (std::size_t k = 0; k < cells; ++k) alongZ[i * cells + k] = bend(spanZ[k], i, columns);
  const auto blended = [&](const std::vector<float>& along, const Span& across, std::size_t k) {
    float middle = 0, outer = 0;
    for (std::size_t n = across.first; n <= across.last; ++n) {
      const auto at = [&](std::size_t line) { return along[line * cells + k]; };
      middle = std::max({middle, at(n), at(n + 1)});
      outer = std::max({outer, at(n - 1), at(n + 2)});
    }
    return 1.125f * middle + 0.125f * outer;
  };
  for (std::size_t j = 0; j < cells; ++j)
    for (std::size_t i = 0; i < cells; ++i) {
      float& slack = tile.slack[tile.block(static_cast<int>(i) >> Tile::kBlockBits, static_cast<int>(j) >> Tile::kBlockBits)];
      slack = std::max(slack, blended(alongX, spanZ[j], i) + blended(alongZ, spanX[i], j));
    }
}

}  // namespace ridgecast::box
