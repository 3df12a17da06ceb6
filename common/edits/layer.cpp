#include "common/edits/layer.h"

#include <algorithm>
#include <limits>

#include "common/terrain/raster.h"

namespace ridgecast::edits {

using lattice::Step;

namespace {

// The neighbours of a tile that read its posts where they are not 0: a place reads from one post before it to two after it.
template <class F>
void forEachReader(TileAddress a, const Tile& tile, F&& f) {
  std::int64_t x0 = kTileSide, x1 = -1, z0 = kTileSide, z1 = -1;
  for (std::int64_t z = 0; z < kTileSide; ++z)
    for (std::int64_t x = 0; x < kTileSide; ++x)
      if (tile.rise(slotOf(x, z)) != 0) {
        x0 = std::min(x0, x), x1 = std::max(x1, x);
        z0 = std::min(z0, z), z1 = std::max(z1, z);
      }
  if (x1 < 0) return;
  // Places between posts p and p + 1 read p - 1 to p + 2: post q is read from q - 2 to q + 1.
  for (std::int64_t j = (z0 - 2) >> kTileBits; j <= (z1 + 1) >> kTileBits; ++j)
    for (std::int64_t i = (x0 - 2) >> kTileBits; i <= (x1 + 1) >> kTileBits; ++i)
      if (i != 0 || j != 0) f(TileAddress{a.i + i, a.j + j});
}

const std::shared_ptr<const Tile>& zeroTile() {
  static const std::shared_ptr<const Tile> zero = std::make_shared<const Tile>();
  return zero;
}

}  // namespace

Tile::Tile(const TilePosts& posts) : material_(posts.material) {
  const auto [least, most] = std::ranges::minmax(posts.rise);
  lowest_ = least, highest_ = most;
  using Narrow = std::numeric_limits<std::int16_t>;
  if (least < Narrow::min() || most > Narrow::max())
    wide_ = std::make_unique<const std::array<std::int32_t, kTileSide * kTileSide>>(posts.rise);
  else
    std::ranges::transform(posts.rise, rise_.begin(), [](std::int32_t v) { return static_cast<std::int16_t>(v); });
}

TilePosts Tile::posts() const {
  TilePosts out{.rise = {}, .material = material_};
  for (std::size_t k = 0; k < out.rise.size(); ++k) out.rise[k] = rise(k);
  return out;
}

std::vector<TileAddress> tilesOf(const Posts& posts, const TileSet* within) {
  std::vector<TileAddress> out;
  if (posts.empty()) return out;
  const std::int64_t j0 = posts.z0 >> kTileBits, j1 = (posts.z1 - 1) >> kTileBits;
  for (std::int64_t i = posts.x0 >> kTileBits; i <= (posts.x1 - 1) >> kTileBits; ++i) {
    if (within)
      for (auto t = within->lower_bound({i, j0}); t != within->end() && *t <= TileAddress{i, j1}; ++t) out.push_back(*t);
    else
      for (std::int64_t j = j0; j <= j1; ++j) out.push_back({i, j});
  }
  return out;
}

bool meets(const Posts& posts, const TileSet& tiles) {
  if (posts.empty()) return false;
  const std::int64_t j0 = posts.z0 >> kTileBits, j1 = (posts.z1 - 1) >> kTileBits;
  for (std::int64_t i = posts.x0 >> kTileBits; i <= (posts.x1 - 1) >> kTileBits; ++i)
    if (const auto t = tiles.lower_bound({i, j0}); t != tiles.end() && *t <= TileAddress{i, j1}) return true;
  return false;
}

// The parts of a layer that are being written are copied once, then written in place.
class Layer::Writer {
 public:
  explicit Writer(const Layer& from) : layer_(std::make_shared<Layer>(from)) {}

  void set(TileAddress a, std::shared_ptr<const Tile> tile) {
    if (!tile && !layer_->tile(a)) return;
    std::shared_ptr<const Tile>& slot = blockOf(a)[slotInBlock(a)];
    layer_->tiles_ += (tile ? 1 : 0);
    layer_->tiles_ -= (slot ? 1 : 0);
    layer_->wide_ += tile && tile->isWide() ? 1 : 0;
    layer_->wide_ -= slot && slot->isWide() ? 1 : 0;
    layer_->tileBytes_ += tile ? tile->bytes() : 0;
    layer_->tileBytes_ -= slot ? slot->bytes() : 0;
    slot = std::move(tile);
    if (slot) layer_->around_.add(a.posts());
  }
  const Layer& layer() const { return *layer_; }

  std::shared_ptr<const Layer> take() {
    for (const auto& [key, block] : blocks_)
      if (std::ranges::none_of(*block, [](const auto& tile) { return bool(tile); })) {
        (*cells_.at(key.cell))[key.slot] = nullptr;
        --layer_->blocks_;
      }
    for (const auto& [address, cell] : cells_)
      if (std::ranges::none_of(*cell, [](const auto& block) { return bool(block); })) layer_->cells_.erase(address);
    if (layer_->empty()) layer_->around_ = {};
    return std::move(layer_);
  }

 private:
  struct Key {
    CellAddress cell;
    std::size_t slot;
    friend bool operator==(const Key&, const Key&) = default;
  };
  struct HashOfKey {
    std::size_t operator()(const Key& k) const { return lattice::mix(HashOfCell()(k.cell) + k.slot); }
  };
  Block& blockOf(TileAddress a) {
    const CellAddress at{a.i >> (kBlockBits + kCellBits), a.j >> (kBlockBits + kCellBits)};
    const Key key{at, slotInCell(a.i >> kBlockBits, a.j >> kBlockBits)};
    std::shared_ptr<Block>& block = blocks_[key];
    if (block) return *block;
    std::shared_ptr<Cell>& cell = cells_[at];
    if (!cell) {
      std::shared_ptr<const Cell>& there = layer_->cells_[at];
      cell = there ? std::make_shared<Cell>(*there) : std::make_shared<Cell>();
      there = cell;
    }
    std::shared_ptr<const Block>& there = (*cell)[key.slot];
    if (!there) ++layer_->blocks_;
    block = there ? std::make_shared<Block>(*there) : std::make_shared<Block>();
    there = block;
    return *block;
  }

  std::shared_ptr<Layer> layer_;
  std::unordered_map<CellAddress, std::shared_ptr<Cell>, HashOfCell> cells_;
  std::unordered_map<Key, std::shared_ptr<Block>, HashOfKey> blocks_;
};

const Layer::Cell* Layer::cell(CellAddress address) const {
  const auto it = cells_.find(address);
  return it == cells_.end() ? nullptr : it->second.get();
}

const std::shared_ptr<const Tile>& Layer::shared(TileAddress a) const {
  const Cell* const c = cell({a.i >> (kBlockBits + kCellBits), a.j >> (kBlockBits + kCellBits)});
  return c ? tileOf(*c, a) : none();
}

std::size_t Layer::bytesBeside(const Layer& other) const {
  const std::size_t bytesOfTile = sizeof(Tile) + (wide_ > 0 ? kTileSide * kTileSide * sizeof(std::int32_t) : 0);
  std::size_t bytes = 0;
  for (const auto& [at, cell] : cells_) {
    const Cell* const theirs = other.cell(at);
    if (cell.get() == theirs) continue;
    bytes += sizeof(Cell);
    for (std::size_t b = 0; b < cell->size(); ++b) {
      const Block *const mine = (*cell)[b].get(), *const its = theirs ? (*theirs)[b].get() : nullptr;
      if (mine == its || !mine) continue;
      bytes += sizeof(Block);
      for (std::size_t t = 0; t < mine->size(); ++t)
        if ((*mine)[t] && !(its && (*its)[t] == (*mine)[t])) bytes += bytesOfTile;
    }
  }
  return bytes;
}

std::vector<TileAddress> Layer::addresses() const {
  std::vector<TileAddress> out;
  out.reserve(tiles_);
  for (const auto& [at, cell] : cells_)
    for (std::size_t b = 0; b < cell->size(); ++b) {
      if (!(*cell)[b]) continue;
      const Block& block = *(*cell)[b];
      for (std::size_t t = 0; t < block.size(); ++t) {
        if (!block[t]) continue;
        const auto part = [&](std::int64_t whole, std::size_t blockOfIt, std::size_t tileOfIt) {
          return (((whole << kCellBits) + static_cast<std::int64_t>(blockOfIt)) << kBlockBits) + static_cast<std::int64_t>(tileOfIt);
        };
        constexpr std::size_t kInBlock = (1 << kBlockBits) - 1, kInCell = (1 << kCellBits) - 1;
        out.push_back({part(at.i, b & kInCell, t & kInBlock), part(at.j, b >> kCellBits, t >> kBlockBits)});
      }
    }
  std::ranges::sort(out);
  return out;
}

void Layer::forEachTile(const Posts& posts, const std::function<void(TileAddress, const Tile&)>& f) const {
  if (posts.empty() || empty()) return;
  constexpr int kCellShift = kTileBits + kBlockBits + kCellBits, kBlockShift = kTileBits + kBlockBits;
  const auto inCell = [&](CellAddress at, const Cell& cell) {
    const auto within = [&](std::int64_t from, std::int64_t to, std::int64_t whole, int shift, int bits) {
      const std::int64_t first = whole << bits;
      return std::pair(std::max(from >> shift, first) - first, std::min((to - 1) >> shift, first + (std::int64_t{1} << bits) - 1) - first);
    };
    const auto [i0, i1] = within(posts.x0, posts.x1, at.i, kBlockShift, kCellBits);
    const auto [j0, j1] = within(posts.z0, posts.z1, at.j, kBlockShift, kCellBits);
    for (std::int64_t j = j0; j <= j1; ++j)
      for (std::int64_t i = i0; i <= i1; ++i) {
        const auto& block = cell[static_cast<std::size_t>((j << kCellBits) | i)];
        if (!block) continue;
        const auto [k0, k1] = within(posts.x0, posts.x1, (at.i << kCellBits) + i, kTileBits, kBlockBits);
        const auto [l0, l1] = within(posts.z0, posts.z1, (at.j << kCellBits) + j, kTileBits, kBlockBits);
        for (std::int64_t l = l0; l <= l1; ++l)
          for (std::int64_t k = k0; k <= k1; ++k)
            if (const auto& tile = (*block)[static_cast<std::size_t>((l << kBlockBits) | k)])
              f({(((at.i << kCellBits) + i) << kBlockBits) + k, (((at.j << kCellBits) + j) << kBlockBits) + l}, *tile);
      }
  };
  const std::int64_t i0 = posts.x0 >> kCellShift, i1 = (posts.x1 - 1) >> kCellShift, j0 = posts.z0 >> kCellShift,
                     j1 = (posts.z1 - 1) >> kCellShift;
  if (static_cast<std::uint64_t>(i1 - i0 + 1) * static_cast<std::uint64_t>(j1 - j0 + 1) > cells_.size()) {
    for (const auto& [at, cell] : cells_)
      if (at.i >= i0 && at.i <= i1 && at.j >= j0 && at.j <= j1) inCell(at, *cell);
    return;
  }
  for (std::int64_t j = j0; j <= j1; ++j)
    for (std::int64_t i = i0; i <= i1; ++i)
      if (const Cell* const found = cell({i, j})) inCell({i, j}, *found);
}

std::uint64_t Layer::hash() const {
  std::uint64_t sum = 0;
  for (const TileAddress a : addresses()) sum += hashOf(a);
  return sum;
}

std::uint64_t Layer::hashOf(TileAddress a) const {
  const Tile* const of = tile(a);
  if (!of) return 0;
  std::uint64_t sum = 0;
  const TilePosts t = of->posts();
  for (std::int64_t k = 0; k < kTileSide * kTileSide; ++k) {
    const auto slot = static_cast<std::size_t>(k);
    if (t.rise[slot] == 0 && t.material[slot] == 0) continue;
    const std::uint64_t at = lattice::mix(static_cast<std::uint64_t>(a.i * kTileSide + k % kTileSide) +
                                          lattice::mix(static_cast<std::uint64_t>(a.j * kTileSide + k / kTileSide)));
    sum += lattice::mix(at ^ (static_cast<std::uint64_t>(static_cast<std::uint32_t>(t.rise[slot])) << 8 | t.material[slot]));
  }
  return sum;
}

std::int32_t Layer::riseAt(std::int64_t x, std::int64_t z) const {
  const Tile* const t = tile({x >> kTileBits, z >> kTileBits});
  return t ? t->rise(slotOf(x, z)) : 0;
}

std::uint8_t Layer::materialAt(lattice::Point p) const {
  const std::int64_t x = (p.x + kPostSteps / 2) >> kPostBits, z = (p.z + kPostSteps / 2) >> kPostBits;
  const Tile* const t = tile({x >> kTileBits, z >> kTileBits});
  return t ? t->material(slotOf(x, z)) : 0;
}

std::shared_ptr<const Layer> Layer::with(const std::vector<Change>& changes) const {
  Writer writer(*this);
  for (const Change& c : changes) writer.set(c.address, c.tile);
  for (const Change& c : changes) {
    if (c.tile) {
      forEachReader(c.address, *c.tile, [&](TileAddress reader) {
        if (!writer.layer().tile(reader)) writer.set(reader, zeroTile());
      });
      continue;
    }
    // A tile that went may be read for its neighbours' sake.
    for (std::int64_t j = -1; j <= 1; ++j)
      for (std::int64_t i = -1; i <= 1; ++i) {
        const TileAddress beside{c.address.i + i, c.address.j + j};
        if (const Tile* const t = writer.layer().tile(beside); t && (i != 0 || j != 0))
          forEachReader(beside, *t, [&](TileAddress reader) {
            if (reader == c.address && !writer.layer().tile(reader)) writer.set(reader, zeroTile());
          });
      }
  }
  return writer.take();
}

}  // namespace ridgecast::edits
