#include "server/box/samples.h"

#include <algorithm>
#include <cmath>

#include "common/outcome/contract.h"
#include "common/terrain/raster.h"
#include "server/box/map_tile.h"

namespace ridgecast::box {

using lattice::Step;
using triangulation::Point2;

namespace {

constexpr float kMargin = 4;  // of measured curvature, for what a finer grid would find

// Only where heights are the map's own do its posts say what lies between them: edits may lie on it.
const terrain::Raster* ownMap(const terrain::Terrain& terrain) {
  const terrain::Raster* const map = terrain.raster();
  return dynamic_cast<const terrain::Terrain*>(map) == &terrain ? map : nullptr;
}

}  // namespace

Samples::Samples(const terrain::Terrain& terrain, const Frame& frame, Point2 low, Point2 high, int bits)
    : terrain_(terrain), map_(ownMap(terrain)), frame_(frame), low_(low), high_(high), bits_(bits) {
  lay();
}

void Samples::lay() {
  const int shift = bits_ + kCellBits;
  first_ = {(low_.x >> shift) << shift, (low_.z >> shift) << shift};
  across_ = ((high_.x - first_.x) >> shift) + 1;
  down_ = ((high_.z - first_.z) >> shift) + 1;
  for (std::int32_t j = 0; j < down_; ++j)
    for (std::int32_t i = 0; i < across_; ++i) add({first_.x + (i << shift), first_.z + (j << shift)}, bits_, kCellBits);
}

float Samples::slack() const {
  double sum = 0;
  for (const Tile& tile : tiles_) sum += static_cast<double>(tile.rough);
  return static_cast<float>(sum / static_cast<double>(tiles_.size()));
}

bool Samples::halves(std::uint64_t most) {
  expects(finer_.empty(), "the first samples are halved before any block is refined");
  if (bits_ == 0 || 4 * count_ > most) return false;
  tiles_.clear();
  heights_ = {};
  slacks_ = {};
  count_ = 0;
  --bits_;
  lay();
  return true;
}

void Samples::add(Point2 corner, int bits, int cellBits, std::int32_t coarser) {
  Tile tile{.corner = corner,
            .bits = bits,
            .cellBits = cellBits,
            .slackBits = proves() && bits + frame_.unitBits > 0 ? 0 : Tile::kBlockBits,
            .coarser = coarser};
  tile.height = heights_.take(tile.count());
  tile.slack = slacks_.take(tile.squares());
  tiles_.push_back(tile);
  count_ += tile.count();
}

void Samples::refine(const Block& at) {
  expects(finer(at) < 0 && tiles_[at.tile].bits > 0, "a block is refined once, down to every unit");
  Tile& tile = tiles_[at.tile];
  if (tile.finer < 0) {
    tile.finer = static_cast<std::int32_t>(finer_.size());
    finer_.resize(finer_.size() + static_cast<std::size_t>(tile.blocks()) * static_cast<std::size_t>(tile.blocks()), -1);
  }
  finer_[static_cast<std::size_t>(tile.finer) + at.block] = static_cast<std::int32_t>(tiles_.size());
  const auto i = static_cast<std::int32_t>(at.block) % tile.blocks(), j = static_cast<std::int32_t>(at.block) / tile.blocks();
  const int shift = tile.bits + Tile::kBlockBits;
  add({tile.corner.x + (i << shift), tile.corner.z + (j << shift)}, tile.bits - 1, Tile::kBlockBits + 1,
      static_cast<std::int32_t>(at.tile));
}

std::optional<float> Samples::at(Point2 p) const {
  std::optional<float> height;
  forEach(p, p, [&](std::size_t number) {
    for (;;) {
      const Tile& tile = tiles_[number];
      if (tile.rough < 0) return;
      const std::int32_t x = p.x - tile.corner.x, z = p.z - tile.corner.z, i = x >> tile.bits, j = z >> tile.bits;
      if ((i << tile.bits) == x && (j << tile.bits) == z) height = tile.height[tile.index(i, j)];
      const std::int32_t next = height ? -1 : finer({number, tile.block(i >> Tile::kBlockBits, j >> Tile::kBlockBits)});
      if (next < 0) return;
      number = static_cast<std::size_t>(next);
    }
  });
  return height;
}

bool Samples::proves() const { return map_ && spacing() <= kPostsACell * map_->shape().finest(); }

void Samples::fill(std::size_t number) {
  expects(number < tiles_.size(), "a tile that is filled is there");
  Tile& tile = tiles_[number];
  std::fill_n(tile.slack, tile.squares(), Slack{});
  if (proves())
    sampleMap(*map_, frame_, tile);
  else
    measure(tile);
  if (const terrain::Raster* const edits = terrain_.edits(); edits && tile.bits + frame_.unitBits > 0) addEdits(*edits, frame_, tile);
  float sum = 0;
  for (std::size_t k = 0; k < tile.squares(); ++k) {
    sum += tile.slack[k].most();
    tile.most = std::max(tile.most, tile.slack[k].most());
  }
  tile.rough = sum / static_cast<float>(tile.squares());
}

void Samples::ask(Tile& tile) const {
  const int across = tile.across();
  thread_local std::vector<Step> x, z;
  thread_local std::vector<float> asked;
  x.resize(tile.count());
  z.resize(tile.count());
  asked.resize(tile.count());
  // f(i, j), but where a coarser tile has the sample.
  const auto forEach = [&](auto&& f) {
    for (int j = 0; j < across; ++j) {
      const int known = tile.coarser >= 0 && j % 2 == 0 ? 1 : 0;
      for (int i = known; i < across; i += 1 + known) f(i, j);
    }
  };
  const lattice::Point corner = frame_.global(tile.corner);
  const int shift = tile.bits + frame_.unitBits;
  std::size_t count = 0;
  forEach([&](int i, int j) {
    x[count] = corner.x + (Step{i} << shift);
    z[count++] = corner.z + (Step{j} << shift);
  });
  terrain_.heights({x.data(), count}, {z.data(), count}, {asked.data(), count});
  forEach([&, k = std::size_t{0}](int i, int j) mutable { tile.height[tile.index(i, j)] = asked[k++]; });
  if (tile.coarser < 0) return;
  const Tile& known = tiles_[static_cast<std::size_t>(tile.coarser)];
  const std::int32_t i0 = (tile.corner.x - known.corner.x) >> known.bits, j0 = (tile.corner.z - known.corner.z) >> known.bits;
  for (int j = 0; j < across; j += 2)
    for (int i = 0; i < across; i += 2) tile.height[tile.index(i, j)] = known.height[known.index(i0 + i / 2, j0 + j / 2)];
}

void Samples::measure(Tile& tile) const {
  ask(tile);
  if (tile.bits + frame_.unitBits == 0) return;  // every point of the lattice
  const std::size_t across = static_cast<std::size_t>(tile.across()), cells = across - 1;
  constexpr int side = 1 << Tile::kBlockBits;
  // Those on the tile's border are their neighbours'.
  thread_local std::vector<float> bend;
  bend.resize(tile.count());
  for (std::size_t j = 1; j < cells; ++j) {
    const float* const h = &tile.height[j * across];
    float* const to = &bend[j * across];
    for (std::size_t i = 1; i < cells; ++i)
      to[i] = std::abs(h[i - 1] - 2 * h[i] + h[i + 1]) + std::abs((h + i)[-static_cast<std::ptrdiff_t>(across)] - 2 * h[i] + h[i + across]);
    to[0] = to[1];
    to[cells] = to[cells - 1];
  }
  std::copy_n(&bend[across], across, bend.begin());
  std::copy_n(&bend[(cells - 1) * across], across, &bend[cells * across]);
  for (int j = 0; j < tile.blocks(); ++j)
    for (int i = 0; i < tile.blocks(); ++i) {
      float most = 0;
      for (int row = j * side; row <= (j + 1) * side; ++row)
        for (int column = i * side; column <= (i + 1) * side; ++column) most = std::max(most, bend[tile.index(column, row)]);
      tile.slack[tile.block(i, j)] = {kMargin / 8 * most, kMargin / 8 * most};
    }
}

}  // namespace ridgecast::box
