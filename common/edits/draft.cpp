#include "common/edits/draft.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace ridgecast::edits {
namespace {

using lattice::Step;

// Steps of a terrain's own height at a rectangle of posts, along x first.
std::vector<std::int32_t> ownHeights(const terrain::Terrain& terrain, const Posts& posts) {
  std::vector<Step> x, z;
  for (std::int64_t b = posts.z0; b < posts.z1; ++b)
    for (std::int64_t a = posts.x0; a < posts.x1; ++a) {
      x.push_back(a << kPostBits);
      z.push_back(b << kPostBits);
    }
  std::vector<std::int32_t> out(x.size());
  terrain.heightSteps(x, z, out);
  return out;
}

std::int32_t limited(std::int64_t rise) { return static_cast<std::int32_t>(std::clamp<std::int64_t>(rise, -kMaxRise, kMaxRise)); }

// One pass: weights 1 2 1 along both axes, nearest whole steps. The result is a post narrower on each side.
std::vector<std::int32_t> passed(const std::vector<std::int32_t>& from, std::int64_t columns, std::int64_t rows) {
  std::vector<std::int32_t> out;
  out.reserve(static_cast<std::size_t>((columns - 2) * (rows - 2)));
  const auto at = [&](std::int64_t a, std::int64_t b) { return std::int64_t{from[static_cast<std::size_t>(b * columns + a)]}; };
  for (std::int64_t b = 1; b < rows - 1; ++b)
    for (std::int64_t a = 1; a < columns - 1; ++a) {
      const auto row = [&](std::int64_t of) { return at(a - 1, of) + 2 * at(a, of) + at(a + 1, of); };
      out.push_back(static_cast<std::int32_t>((row(b - 1) + 2 * row(b) + row(b + 1) + 8) >> 4));
    }
  return out;
}

}  // namespace

const std::shared_ptr<const Tile>& Draft::tile(TileAddress address) const {
  const auto written = tiles_.find(address);
  return written == tiles_.end() ? on_->shared(address) : written->second;
}

TilePosts Draft::postsOf(TileAddress address) const {
  const auto& there = tile(address);
  return there ? there->posts() : TilePosts();
}

TileSet Draft::written() const {
  TileSet out;
  for (const auto& [address, tile] : tiles_) out.insert(out.end(), address);
  return out;
}

Turns Draft::apply(const terrain::Terrain& terrain, const Operation& operation, const TileSet* within, std::uint64_t& looked) {
  if (std::holds_alternative<Undo>(operation.what)) co_return;
  if (std::holds_alternative<Smooth>(operation.what)) {
    for (Turns turns = smooth(terrain, operation, within, looked); const auto cost = turns.next();) co_yield *cost;
    co_return;
  }
  Brush brush(operation);
  const Posts area = areaOf(operation);
  for (const TileAddress address : tilesOf(area, within)) {
    std::uint64_t cost = static_cast<std::uint64_t>(kTileSide) * brush.effort();
    if (brush.reaches(middleOf(address), kHalfDiagonal)) {
      cost = brush.effort() * static_cast<std::uint64_t>(area.within(address.posts()).count());
      looked += cost;
      brushTile(terrain, operation, brush, address);
    }
    co_yield cost;
  }
}

void Draft::brushTile(const terrain::Terrain& terrain, const Operation& operation, const Brush& brush, TileAddress address) {
  const Posts posts = address.posts();
  const bool reads = readsGround(operation);
  const TilePosts before = postsOf(address);
  std::vector<std::int32_t> own;
  if (reads) own = ownHeights(terrain, posts);
  TilePosts after = before;
  for (std::size_t k = 0; k < kTileSide * kTileSide; ++k) {
    const lattice::Point post{(posts.x0 + static_cast<std::int64_t>(k) % kTileSide) << kPostBits,
                              (posts.z0 + static_cast<std::int64_t>(k) / kTileSide) << kPostBits};
    const std::int32_t base = reads ? own[k] : 0;
    const auto result = brush.at(post, base + before.rise[k]);
    if (!result) continue;
    after.rise[k] = limited(std::int64_t{result->height} - base);
    if (result->paints && operation.material != 0) after.material[k] = static_cast<std::uint8_t>(operation.material);
  }
  if (after != before) tiles_[address] = std::make_shared<const Tile>(after);
}

Turns Draft::smooth(const terrain::Terrain& terrain, const Operation& operation, const TileSet* within, std::uint64_t& looked) {
  const auto& smooth = std::get<Smooth>(operation.what);
  const Posts area = areaOf(operation), seen = area.wider(smooth.passes);
  std::int64_t columns = seen.x1 - seen.x0, rows = seen.z1 - seen.z0;
  std::vector<std::int32_t> heights;
  heights.reserve(static_cast<std::size_t>(seen.count()));
  constexpr std::int64_t kTogether = 1024;
  for (std::int64_t z = seen.z0, end = z; z < seen.z1; z = end) {
    end = std::min(seen.z1, z + 1 + kTogether / columns);
    std::ranges::copy(ownHeights(terrain, {seen.x0, z, seen.x1, end}), std::back_inserter(heights));
    const auto posts = static_cast<std::uint64_t>((end - z) * columns);
    looked += posts;
    co_yield posts;
  }
  const auto seenSlot = [&](std::int64_t x, std::int64_t z) {
    return static_cast<std::size_t>((z - seen.z0) * (seen.x1 - seen.x0) + x - seen.x0);
  };
  for (const TileAddress address : tilesOf(seen)) {
    const auto& there = tile(address);
    if (!there) continue;
    const Posts both = seen.within(address.posts());
    for (std::int64_t z = both.z0; z < both.z1; ++z)
      for (std::int64_t x = both.x0; x < both.x1; ++x) heights[seenSlot(x, z)] += there->rise(slotOf(x, z));
  }
  std::vector<std::int32_t> after = heights;
  for (std::uint32_t pass = 0; pass < smooth.passes; ++pass, columns -= 2, rows -= 2) {
    after = passed(after, columns, rows);
    co_yield after.size() / 8;
  }
  for (const TileAddress address : tilesOf(area, within)) {
    const Posts both = area.within(address.posts());
    TilePosts posts = postsOf(address);
    bool isChanged = false;
    for (std::int64_t z = both.z0; z < both.z1; ++z)
      for (std::int64_t x = both.x0; x < both.x1; ++x) {
        const Step dx = (x << kPostBits) - smooth.at.x, dz = (z << kPostBits) - smooth.at.z;
        if (dx * dx + dz * dz > smooth.radius * smooth.radius) continue;
        const std::int64_t before = heights[seenSlot(x, z)],
                           next = after[static_cast<std::size_t>((z - area.z0) * (area.x1 - area.x0) + x - area.x0)];
        if (next == before && operation.material == 0) continue;
        isChanged = true;
        const std::size_t slot = slotOf(x, z);
        posts.rise[slot] = limited(posts.rise[slot] + next - before);
        if (operation.material != 0) posts.material[slot] = static_cast<std::uint8_t>(operation.material);
      }
    if (isChanged) tiles_[address] = std::make_shared<const Tile>(posts);
    co_yield static_cast<std::uint64_t>(both.count()) / 8;
  }
}

Turns Draft::copy(const TileSet& tiles, std::shared_ptr<const Layer>& to) const {
  constexpr std::size_t kTogether = 256;
  constexpr std::uint64_t kPostsOfCopy = kTogether * kTileSide;
  Tiles changes;
  TileSet beside;
  std::size_t looked = 0;
  const auto put = [&] {
    std::vector<Layer::Change> all;
    for (auto& [address, tile] : changes) all.push_back({address, std::move(tile)});
    changes.clear();
    if (!all.empty()) to = to->with(all);
  };
  for (const TileAddress address : tiles) {
    if (++looked % kTogether == 0) {
      put();
      co_yield kPostsOfCopy;
    }
    std::shared_ptr<const Tile> is = tile(address);
    if (is && is->isZero()) is = nullptr;
    const Tile* const was = to->tile(address);
    if (is ? was && *was == *is : !was || was->isZero()) continue;
    for (std::int64_t j = -1; j <= 1; ++j)
      for (std::int64_t i = -1; i <= 1; ++i)
        if (const Tile* const there = to->tile({address.i + i, address.j + j}); there && there->isZero())
          beside.insert({address.i + i, address.j + j});
    changes[address] = std::move(is);
  }
  // Tiles that were there for the sake of those that changed; the layer puts back the ones that still are.
  for (const TileAddress address : beside)
    if (const Tile* const there = to->tile(address); there && there->isZero()) changes.try_emplace(address);
  put();
  co_yield kPostsOfCopy;
}

}  // namespace ridgecast::edits
