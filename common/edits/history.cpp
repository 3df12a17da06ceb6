#include "common/edits/history.h"

#include <algorithm>
#include <map>

#include "common/edits/edited_terrain.h"

namespace ridgecast::edits {

using lattice::Step;

namespace {

constexpr lattice::Step kHalfDiagonal = 1449;  // of a tile, steps

TileSet tilesOf(const Posts& posts) {
  TileSet out;
  for (std::int64_t i = posts.x0 >> kTileBits; i <= (posts.x1 - 1) >> kTileBits; ++i)
    for (std::int64_t j = posts.z0 >> kTileBits; j <= (posts.z1 - 1) >> kTileBits; ++j) out.insert({i, j});
  return out;
}

Posts boundsOf(const TileSet& tiles) {
  Posts out;
  for (const TileAddress t : tiles) out.add(t.posts());
  return out;
}

bool meets(const Posts& posts, const TileSet& tiles, const Posts& bounds) {
  return posts.meets(bounds) && std::ranges::any_of(tiles, [&](TileAddress t) { return posts.meets(t.posts()); });
}

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

std::int32_t limited(std::int64_t rise) { return static_cast<std::int32_t>(std::clamp<std::int64_t>(rise, -kMostRise, kMostRise)); }

TilePosts postsOf(const Tile* tile) { return tile ? tile->posts() : TilePosts(); }

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

History::History(std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes)
    : terrain_(std::move(terrain)), mostBytes_(mostBytes) {}

Outcome<Operation> History::prepare(Operation operation) {
  if (auto checked = check(operation); !checked) return checked.error();
  if (const auto* undo = std::get_if<Undo>(&operation.what)) {
    if (undo->edit > last())
      return Error{"There is no edit " + std::to_string(undo->edit) + " to undo; the last is " + std::to_string(last()) + "."};
    if (undo->edit <= compacted_) return Error{"Edit " + std::to_string(undo->edit) + " was compacted and cannot be undone."};
    if (auto all = readAll(); !all) return all.error();
    if (isUndone(undo->edit))
      return Error{"Edit " + std::to_string(undo->edit) + " is undone already; undo the edit that undid it to have it back."};
  }
  if (const auto* road = std::get_if<Road>(&operation.what); road && !road->surveyed) {
    std::vector<Step> x, z;
    for (const lattice::Point p : stationsOf(*road)) {
      x.push_back(p.x);
      z.push_back(p.z);
    }
    if (x.size() > kMostStations)
      return Error{"A road's corners and the stations between them are " + std::to_string(x.size()) + "; the most is " +
                   std::to_string(kMostStations) + ": leave corners out."};
    std::vector<std::int32_t> ground(x.size());
    EditedTerrain(terrain_, layer_).heightSteps(x, z, ground);
    operation.what = survey(*road, ground);
  }
  return operation;
}

Outcome<Posts> History::add(Operation operation) {
  if (last_ - compacted_ >= kMostEdits)
    return Error{"A session has at most " + std::to_string(kMostEdits) +
                 " edits; its operator can join them with `ridgecast-server edits compact`."};
  Posts changed = areaOf(operation);
  std::shared_ptr<const Layer> next;
  const auto* undo = std::get_if<Undo>(&operation.what);
  if (undo) {
    const std::uint64_t edit = addUndos(undo->edit, 1);
    next = edit == 0 ? layer_ : replayed(edit);
    if (edit != 0) {
      // Smoothing carries a change on.
      changed = entry(edit).area;
      for (std::size_t k = indexOf(edit) + 1; k < entries_.size(); ++k)
        if (const Entry& e = entries_[k]; e.counts() && marginOf(e.operation) > 0 && e.area.wider(marginOf(e.operation)).meets(changed))
          changed.add(e.area);
    }
  } else {
    next = layer_->with(changesOf(operation, *layer_, nullptr));
  }
  if (next->bytes() > mostBytes_ && next->bytes() > layer_->bytes()) {
    if (undo) addUndos(undo->edit, -1);
    return Error{"The session's edits take " + std::to_string(mostBytes_ >> 20) +
                 " MiB, which is the most: undo some, or edit where there are edits already."};
  }
  layer_ = std::move(next);
  const Posts area = undo ? Posts() : changed;
  entries_.push_back({std::move(operation), area});
  ++last_;
  return changed;
}

void History::takeBack(std::shared_ptr<const Layer> before) {
  const Entry last = std::move(entries_.back());
  entries_.pop_back();
  --last_;
  if (const auto* undo = std::get_if<Undo>(&last.operation.what)) addUndos(undo->edit, -1);
  layer_ = std::move(before);
}

void History::restore(std::uint64_t compacted, std::uint64_t last, std::shared_ptr<const Layer> layer, Read read) {
  compacted_ = compacted;
  last_ = last;
  entries_.clear();
  layer_ = std::move(layer);
  read_ = std::move(read);
}

Outcome<void> History::readAll() {
  if (!read_) return {};
  auto past = read_();
  if (!past) return past.error();
  if (const std::uint64_t wanted = last_ - compacted_ - entries_.size(); past->operations.size() != wanted)
    return Error{"The log holds " + std::to_string(past->operations.size()) + " edits where there should be " + std::to_string(wanted) +
                 "."};
  std::vector<Entry> all;
  all.reserve(last_ - compacted_);
  for (Operation& o : past->operations) {
    const auto* undo = std::get_if<Undo>(&o.what);
    if (undo && (undo->edit <= compacted_ || undo->edit > compacted_ + all.size()))
      return Error{"Edit " + std::to_string(compacted_ + all.size() + 1) + " of the log undoes edit " + std::to_string(undo->edit) +
                   ", which is not there before it."};
    const Posts area = areaOf(o);
    all.push_back({std::move(o), area});
  }
  std::ranges::move(entries_, std::back_inserter(all));
  entries_ = std::move(all);
  base_ = std::move(past->base);
  read_ = nullptr;
  // The last first: whether it counts is then known.
  for (std::size_t k = past->operations.size(); k-- > 0;)
    if (const auto* undo = std::get_if<Undo>(&entries_[k].operation.what); undo && entries_[k].counts())
      ++entries_[indexOf(undo->edit)].undos;
  return {};
}

Outcome<void> History::replay() {
  if (auto all = readAll(); !all) return all.error();
  layer_ = base_;
  for (const Entry& e : entries_)
    if (e.counts()) layer_ = layer_->with(changesOf(e.operation, *layer_, nullptr));
  return {};
}

std::uint64_t History::addUndos(std::uint64_t edit, int more) {
  for (;;) {
    Entry& entry = entries_[indexOf(edit)];
    const bool counted = entry.counts();
    entry.undos += more;
    if (entry.counts() == counted) return 0;
    const auto* undo = std::get_if<Undo>(&entry.operation.what);
    if (!undo) return edit;
    edit = undo->edit;
    more = entry.counts() ? 1 : -1;
  }
}

std::shared_ptr<const Layer> History::replayed(std::uint64_t edit) const {
  const auto spreads = [](const Entry& e) { return e.counts() && marginOf(e.operation) > 0; };
  TileSet changed = tilesOf(entry(edit).area);
  Posts bounds = boundsOf(changed);
  const auto add = [](TileSet& to, Posts& boundsOfIt, const Posts& posts) {
    to.merge(tilesOf(posts));
    boundsOfIt = boundsOf(to);
  };
  for (std::size_t k = indexOf(edit) + 1; k < entries_.size(); ++k)
    if (const Entry& e = entries_[k]; spreads(e) && meets(e.area.wider(marginOf(e.operation)), changed, bounds))
      add(changed, bounds, e.area);
  TileSet needed = changed;
  Posts neededBounds = bounds;
  for (std::size_t k = entries_.size(); k-- > 0;)
    if (const Entry& e = entries_[k]; spreads(e) && meets(e.area, needed, neededBounds))
      add(needed, neededBounds, e.area.wider(marginOf(e.operation)));

  auto made = base_;
  for (const Entry& e : entries_)
    if (e.counts() && e.area.meets(neededBounds)) made = made->with(changesOf(e.operation, *made, &needed));

  std::map<TileAddress, std::shared_ptr<const Tile>> tiles;
  for (const TileAddress t : changed) {
    const Tile* const tile = made->tile(t);
    tiles[t] = tile && !tile->isZero() ? std::make_shared<const Tile>(tile->posts()) : nullptr;
    // Tiles beside it that were there for its sake alone.
    for (std::int64_t j = -1; j <= 1; ++j)
      for (std::int64_t i = -1; i <= 1; ++i)
        if (const TileAddress beside{t.i + i, t.j + j}; !changed.contains(beside))
          if (const Tile* const there = layer_->tile(beside); there && there->isZero()) tiles[beside] = nullptr;
  }
  std::vector<Layer::Change> changes;
  for (auto& [address, tile] : tiles) changes.push_back({address, std::move(tile)});
  return layer_->with(changes);
}

std::vector<Layer::Change> History::changesOf(const Operation& operation, const Layer& on, const TileSet* within) const {
  if (std::holds_alternative<Undo>(operation.what)) return {};
  if (std::holds_alternative<Smooth>(operation.what)) return smoothed(operation, on, within);
  Brush brush(operation);
  const Posts area = areaOf(operation);
  const bool reads = readsGround(operation);
  std::vector<Layer::Change> out;
  const auto changeTile = [&](TileAddress address) {
    const Posts posts = address.posts();
    const lattice::Point middle{(posts.x0 + kTileSide / 2) << kPostBits, (posts.z0 + kTileSide / 2) << kPostBits};
    if (!brush.reaches(middle, kHalfDiagonal)) return;
    looked_ += brush.effort() * static_cast<std::uint64_t>(area.within(posts).count());
    const TilePosts before = postsOf(on.tile(address));
    std::vector<std::int32_t> own;
    if (reads) own = ownHeights(*terrain_, posts);
    TilePosts after = before;
    for (std::size_t k = 0; k < kTileSide * kTileSide; ++k) {
      const lattice::Point post{(posts.x0 + static_cast<std::int64_t>(k) % kTileSide) << kPostBits,
                                (posts.z0 + static_cast<std::int64_t>(k) / kTileSide) << kPostBits};
      const std::int32_t rise = before.rise[k], base = reads ? own[k] : 0;
      const auto result = brush.at(post, base + rise);
      if (!result) continue;
      const std::int32_t next = limited(std::int64_t{result->height} - base);
      after.rise[k] = next;
      if (result->paints && operation.material != 0) after.material[k] = static_cast<std::uint8_t>(operation.material);
    }
    if (after != before) out.push_back({address, std::make_shared<const Tile>(after)});
  };
  if (within) {
    for (const TileAddress t : *within)
      if (area.meets(t.posts())) changeTile(t);
  } else {
    for (std::int64_t i = area.x0 >> kTileBits; i <= (area.x1 - 1) >> kTileBits; ++i)
      for (std::int64_t j = area.z0 >> kTileBits; j <= (area.z1 - 1) >> kTileBits; ++j) changeTile({i, j});
  }
  return out;
}

std::vector<Layer::Change> History::smoothed(const Operation& operation, const Layer& on, const TileSet* within) const {
  const auto& smooth = std::get<Smooth>(operation.what);
  const Posts area = areaOf(operation), seen = area.wider(smooth.passes);
  looked_ += static_cast<std::uint64_t>(seen.count());
  std::vector<std::int32_t> heights = ownHeights(*terrain_, seen);
  std::size_t k = 0;
  for (std::int64_t z = seen.z0; z < seen.z1; ++z)
    for (std::int64_t x = seen.x0; x < seen.x1; ++x) heights[k++] += on.riseAt(x, z);
  std::vector<std::int32_t> after = heights;
  std::int64_t columns = seen.x1 - seen.x0, rows = seen.z1 - seen.z0;
  for (std::uint32_t pass = 0; pass < smooth.passes; ++pass, columns -= 2, rows -= 2) after = passed(after, columns, rows);

  std::map<TileAddress, TilePosts> tiles;
  for (std::int64_t z = area.z0; z < area.z1; ++z)
    for (std::int64_t x = area.x0; x < area.x1; ++x) {
      const TileAddress address{x >> kTileBits, z >> kTileBits};
      if (within && !within->contains(address)) continue;
      const Step dx = (x << kPostBits) - smooth.at.x, dz = (z << kPostBits) - smooth.at.z;
      if (dx * dx + dz * dz > smooth.radius * smooth.radius) continue;
      const std::int64_t before = heights[static_cast<std::size_t>((z - seen.z0) * (seen.x1 - seen.x0) + x - seen.x0)],
                         next = after[static_cast<std::size_t>((z - area.z0) * (area.x1 - area.x0) + x - area.x0)];
      if (next == before && operation.material == 0) continue;
      const auto [found, isNew] = tiles.try_emplace(address);
      TilePosts& tile = found->second;
      if (isNew) tile = postsOf(on.tile(address));
      const auto slot = static_cast<std::size_t>((z & (kTileSide - 1)) * kTileSide + (x & (kTileSide - 1)));
      tile.rise[slot] = limited(tile.rise[slot] + next - before);
      if (operation.material != 0) tile.material[slot] = static_cast<std::uint8_t>(operation.material);
    }
  std::vector<Layer::Change> out;
  for (const auto& [address, tile] : tiles) out.push_back({address, std::make_shared<const Tile>(tile)});
  return out;
}

}  // namespace ridgecast::edits
