// Heights with what posts add to them. Tiles are found, and sent for from memory, before the terrain computes its own heights: reading the
// posts waits for nothing then.

#include <algorithm>
#include <array>

#include "common/edits/layer.h"
#include "common/terrain/raster.h"
#include "common/terrain/terrain.h"

namespace ridgecast::edits {

using lattice::Step;
using terrain::CubicPlaces;

namespace {

constexpr std::size_t kMax = CubicPlaces::kMax;

using Four = std::int32_t __attribute__((vector_size(16)));
using Shorts = std::int16_t __attribute__((vector_size(16)));

// Four posts of a row, the first in the lowest bits.
std::uint64_t rowAt(const std::int16_t* from) {
  std::uint64_t out = 0;
  __builtin_memcpy(&out, from, sizeof out);
  return out;
}

Shorts inLowerHalf(std::uint64_t row) {
  using Two = std::uint64_t __attribute__((vector_size(16)));
  return reinterpret_cast<Shorts>(Two{row, 0});
}

// Of shorts that stand in the lower or upper half.
template <int kHalf>
Four widened(Shorts s) {
  const Shorts twice =
      kHalf == 0 ? __builtin_shufflevector(s, s, 0, 0, 1, 1, 2, 2, 3, 3) : __builtin_shufflevector(s, s, 4, 4, 5, 5, 6, 6, 7, 7);
  return reinterpret_cast<Four>(twice) >> 16;
}

// A row at each of four places, as columns of the four: out[c] has post c of each.
std::array<Four, 4> transposed(std::uint64_t a, std::uint64_t b, std::uint64_t c, std::uint64_t d) {
  const Shorts ac = __builtin_shufflevector(inLowerHalf(a), inLowerHalf(c), 0, 8, 1, 9, 2, 10, 3, 11),
               bd = __builtin_shufflevector(inLowerHalf(b), inLowerHalf(d), 0, 8, 1, 9, 2, 10, 3, 11);
  const Shorts low = __builtin_shufflevector(ac, bd, 0, 8, 1, 9, 2, 10, 3, 11),
               high = __builtin_shufflevector(ac, bd, 4, 12, 5, 13, 6, 14, 7, 15);
  return {widened<0>(low), widened<1>(low), widened<0>(high), widened<1>(high)};
}

}  // namespace

// The way from a place to its tile. Remembers the last cell.
class Layer::Finder {
 public:
  explicit Finder(const Layer& layer) : layer_(layer) {}

  const Tile* tileAt(Step x, Step z) {
    const Cell* const cell = cellAt(x, z);
    return cell ? tileOf(*cell, {x >> kTileStepBits, z >> kTileStepBits}).get() : nullptr;
  }

  // False: no tile meets them.
  bool mayMeet(const Posts& posts) {
    constexpr int kShift = kTileBits + kBlockBits;
    const std::int64_t i0 = posts.x0 >> kShift, i1 = (posts.x1 - 1) >> kShift, j0 = posts.z0 >> kShift, j1 = (posts.z1 - 1) >> kShift;
    constexpr std::int64_t kMaxBlocks = 128;
    if (i1 - i0 >= kMaxBlocks || j1 - j0 >= kMaxBlocks / (i1 - i0 + 1)) return true;
    for (std::int64_t j = j0; j <= j1; ++j)
      for (std::int64_t i = i0; i <= i1; ++i) {
        const Cell* const cell = cellAt(i << (kShift + kPostBits), j << (kShift + kPostBits));
        if (cell && (*cell)[slotInCell(i, j)]) return true;
      }
    return false;
  }

  // The tiles of the 4 x 4 posts around a place after post (x, z), which need not be one.
  struct Around {
    std::array<std::array<const Tile*, 2>, 2> tiles;  // along z, along x
    std::int64_t x0, z0;
    const Tile& of(std::int64_t x, std::int64_t z) const { return *tiles[(z ^ z0) >> kTileBits != 0][(x ^ x0) >> kTileBits != 0]; }
    bool anyWide() const { return tiles[0][0]->isWide() || tiles[0][1]->isWide() || tiles[1][0]->isWide() || tiles[1][1]->isWide(); }
    // The row of posts at z, unless a tile is wide: the last ones of the left tile, then the first ones of the right.
    std::uint64_t row(std::int64_t z) const {
      const auto& [left, right] = tiles[(z ^ z0) >> kTileBits != 0];
      const std::int64_t start = x0 & (kTileSide - 1), from = std::min<std::int64_t>(start, kTileSide - 4);
      const int shift = static_cast<int>(16 * (start - from));
      return rowAt(left->narrow() + slotOf(from, z)) >> shift | rowAt(right->narrow() + slotOf(0, z)) << 1 << (63 - shift);
    }
  };
  // Written where it is to lie: a copy would wait for what has just been written.
  void findAround(std::int64_t x, std::int64_t z, Around& out) {
    static const Tile zero;
    out.x0 = x - 1, out.z0 = z - 1;
    const std::int64_t x1 = x + 2, z1 = z + 2;
    const auto tileOf = [this](std::int64_t i, std::int64_t j) {
      const Tile* const tile = tileAt(i << kPostBits, j << kPostBits);
      return tile ? tile : &zero;
    };
    const bool twoX = (out.x0 ^ x1) >> kTileBits != 0, twoZ = (out.z0 ^ z1) >> kTileBits != 0;
    const Tile* const first = tileOf(out.x0, out.z0);
    const Tile* const right = twoX ? tileOf(x1, out.z0) : first;
    const Tile* const below = twoZ ? tileOf(out.x0, z1) : first;
    out.tiles[0][0] = first, out.tiles[0][1] = right, out.tiles[1][0] = below;
    out.tiles[1][1] = twoX && twoZ ? tileOf(x1, z1) : twoX ? right : below;
    for (std::int64_t b = 0; b < 4; b += 3)
      for (std::int64_t a = 0; a < 4; a += 3) __builtin_prefetch(out.of(out.x0 + a, out.z0 + b).narrow() + slotOf(out.x0 + a, out.z0 + b));
  }

 private:
  const Cell* cellAt(Step x, Step z) {
    if (((x ^ x_) | (z ^ z_)) >> lattice::kCellBits != 0) {
      x_ = x, z_ = z;
      cell_ = layer_.cell({x >> lattice::kCellBits, z >> lattice::kCellBits});
    }
    return cell_;
  }
  const Layer& layer_;
  Step x_ = std::int64_t{1} << 62, z_ = 0;  // a place in the cell
  const Cell* cell_ = nullptr;
};

// Up to kMax places, of which those that have a tile are found.
class Layer::Places {
 public:
  void find(Finder& finder, const Step* x, const Step* z, std::size_t count) {
    x_ = x, z_ = z;
    std::size_t insides = 0, borders = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const Tile* const tile = finder.tileAt(x[k], z[k]);
      if (!tile) continue;
      const std::size_t slot = slotOf(x[k] >> kPostBits, z[k] >> kPostBits);
      const std::int16_t* const post = tile->narrow() + slot;
      for (const std::int64_t row : {-1, 1, 2}) __builtin_prefetch(post + row * kTileSide);  // two rows lie in a line of memory
      whose_[insides] = border_[borders] = static_cast<std::uint32_t>(k);
      tile_[insides] = tile;
      first_[insides] = post - kTileSide - 1;
      const std::uint32_t i = slot % kTileSide - 1, j = slot / kTileSide - 1;
      const bool inside = (i <= kTileSide - 4) & (j <= kTileSide - 4);
      insides += inside;
      borders += !inside;
    }
    for (std::size_t k = 0; k < borders; ++k) finder.findAround(x[border_[k]] >> kPostBits, z[border_[k]] >> kPostBits, around_[k]);
    std::copy_n(border_.begin(), borders, whose_.begin() + static_cast<std::ptrdiff_t>(insides));
    insides_ = insides, found_ = insides + borders;
  }

  void raise(bool mayBeWide, float* heights) const {
    if (found_ == 0) return;
    const std::size_t found = found_;
    thread_local std::array<std::array<std::uint64_t, kMax>, 4> rows;
    for (std::size_t k = 0; k < insides_; ++k)
      for (std::size_t row = 0; row < 4; ++row) rows[row][k] = rowAt(first_[k] + row * kTileSide);
    for (std::size_t k = insides_; k < found; ++k) {
      const Finder::Around& around = around_[k - insides_];
      for (std::size_t row = 0; row < 4; ++row) rows[row][k] = around.row(around.z0 + static_cast<std::int64_t>(row));
    }
    thread_local CubicPlaces places;
    for (std::size_t k = 0; k < found; k += 4)
      for (std::size_t row = 0; row < 4; ++row) {
        const auto columns = transposed(rows[row][k], rows[row][k + 1], rows[row][k + 2], rows[row][k + 3]);
        for (std::size_t c = 0; c < 4; ++c) __builtin_memcpy(&places.samples[4 * row + c][k], &columns[c], sizeof(Four));
      }
    if (mayBeWide) replaceWide(places);
    for (std::size_t k = 0; k < found; ++k) {
      places.beyondX[k] = static_cast<float>(x_[whose_[k]] & (kPostSteps - 1));
      places.beyondZ[k] = static_cast<float>(z_[whose_[k]] & (kPostSteps - 1));
    }
    constexpr float kInverse = 1.0f / kPostSteps;
    std::array<float, kMax> rise;
    terrain::cubicHeights(places, static_cast<int>(found), kInverse, kInverse, rise.data());
    for (std::size_t k = 0; k < found; ++k) {
      float& height = heights[whose_[k]];
      height = rise[k] == 0.0f ? height : height + rise[k];
    }
  }

 private:
  void replaceWide(CubicPlaces& places) const {
    const auto copy = [&places](std::size_t place, const auto& rise) {
      for (std::int64_t b = 0; b < 4; ++b)
        for (std::int64_t a = 0; a < 4; ++a) places.samples[4 * b + a][place] = rise(a, b);
    };
    for (std::size_t k = 0; k < insides_; ++k) {
      const std::int64_t first = first_[k] - tile_[k]->narrow();
      if (tile_[k]->isWide())
        copy(k, [&](std::int64_t a, std::int64_t b) { return tile_[k]->rise(static_cast<std::size_t>(first + kTileSide * b + a)); });
    }
    for (std::size_t k = insides_; k < found_; ++k) {
      const Finder::Around& around = around_[k - insides_];
      const auto rise = [&](std::int64_t a, std::int64_t b) {
        return around.of(around.x0 + a, around.z0 + b).rise(slotOf(around.x0 + a, around.z0 + b));
      };
      if (around.anyWide()) copy(k, rise);
    }
  }

  const Step *x_ = nullptr, *z_ = nullptr;
  std::array<std::uint32_t, kMax> whose_, border_;  // found ones: first those whose posts are all of their tile, then the others
  std::array<const Tile*, kMax> tile_;              // of the former
  std::array<const std::int16_t*, kMax> first_;     // the first of their posts
  std::array<Finder::Around, kMax> around_;         // of the latter
  std::size_t insides_ = 0, found_ = 0;
};

void Layer::heights(const terrain::Terrain& terrain, std::span<const Step> x, std::span<const Step> z, std::span<float> out) const {
  if (empty()) return terrain.heights(x, z, out);
  Finder finder(*this);
  std::array<Places, 4> places;
  constexpr std::size_t kTogether = 4 * kMax;
  for (std::size_t begin = 0; begin < out.size(); begin += kTogether) {
    const std::size_t end = std::min(begin + kTogether, out.size());
    const terrain::Extent extent = terrain::extentOf(&x[begin], &z[begin], end - begin);
    const Posts posts{extent.x0 >> kPostBits, extent.z0 >> kPostBits, (extent.x1 >> kPostBits) + 1, (extent.z1 >> kPostBits) + 1};
    const auto own = [&] {
      terrain.heights(x.subspan(begin, end - begin), z.subspan(begin, end - begin), out.subspan(begin, end - begin));
    };
    if (!posts.meets(around_) || !finder.mayMeet(posts)) {
      own();
      continue;
    }
    for (std::size_t k = begin; k < end; k += kMax) places[(k - begin) / kMax].find(finder, &x[k], &z[k], std::min(kMax, end - k));
    own();
    for (std::size_t k = begin; k < end; k += kMax) places[(k - begin) / kMax].raise(wide_ > 0, &out[k]);
  }
}

}  // namespace ridgecast::edits
