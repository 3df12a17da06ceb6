// Undos: what an edit that counts no longer, or again, changes of the ground.

#include <algorithm>
#include <set>

#include "common/edits/draft.h"
#include "common/edits/history.h"
#include "common/edits/packed.h"

namespace ridgecast::edits {
namespace {

constexpr std::uint64_t kPostsOfRead = 16;                          // unpacking an edit takes as long as looking at so many posts
constexpr std::uint64_t kPostsOfAgain = 128;                        // what making one again takes besides
constexpr std::uint64_t kCheckpointPosts = std::uint64_t{1} << 18;  // of work between the newest checkpoints: some milliseconds

Posts boundsOf(const TileSet& tiles) {
  Posts out;
  for (const TileAddress t : tiles) out.add(t.posts());
  return out;
}

// Adds an edit's tiles. Returns the posts of those that were not there.
Posts addTo(TileSet& tiles, const Posts& posts) {
  Posts fresh;
  for (const TileAddress t : tilesOf(posts))
    if (tiles.insert(t).second) fresh.add(t.posts());
  return fresh;
}

std::uint64_t costToRead(const Operation& o) {
  const auto* const stamp = std::get_if<Stamp>(&o.what);
  return kPostsOfRead + (stamp ? stamp->samples.size() / 8 : 0);
}

// At most, where these tiles alone are changed.
std::uint64_t costToMake(const Operation& o, const TileSet& within) {
  const Posts area = areaOf(o);
  std::uint64_t posts = 0;
  if (marginOf(o) > 0) {
    posts = static_cast<std::uint64_t>(area.wider(marginOf(o)).count());
  } else {
    for (const TileAddress t : tilesOf(area, &within)) posts += static_cast<std::uint64_t>(area.within(t.posts()).count());
    posts *= Brush(o).effort();
  }
  return kPostsOfAgain + posts;
}

}  // namespace

std::uint64_t History::addUndos(std::uint64_t edit, int more) {
  for (;;) {
    const bool counted = counts(edit);
    entries_.undos(indexOf(edit)) += static_cast<std::uint32_t>(more);
    if (counts(edit) == counted) return 0;
    const std::uint64_t undone = undoneBy(packed(edit));
    if (undone == 0) return edit;
    more = counted ? -1 : 1;
    edit = undone;
  }
}

Turns History::findGround(std::uint64_t edit, Undoing& undo) const {
  for (std::uint32_t more = 1;;) {
    const bool isCounted = entries_.undos(indexOf(edit)) + more == 0;
    if (isCounted == counts(edit)) co_return;
    co_yield kPostsOfRead;
    const std::uint64_t undone = undoneBy(packed(edit));
    if (undone == 0) {
      undo.edit = edit;
      co_return;
    }
    edit = undone;
    more = isCounted ? 1u : ~0u;
  }
}

std::uint64_t History::addSmooths(const Posts& where, std::uint64_t after, std::uint64_t before, const Undoing& undo,
                                  std::set<std::uint32_t>& to) const {
  const std::size_t looked = smooths_.forEach(where, [&](std::uint32_t edit, const Posts&) {
    if (compacted_ + edit > after && compacted_ + edit < before && to.size() <= undo.mostPosts / kPostsOfRead) to.insert(edit);
  });
  return looked / 16 + kPostsOfRead * to.size();
}

// In order: what an edit has not changed yet when a smoothing reads it, that carries nothing on.
Turns History::findChanged(Undoing& undo, Posts& changed) const {
  if (undo.edit == 0) co_return;
  const Operation undone = operation(undo.edit);
  changed = areaOf(undone);
  Brush brush(undone);
  for (const TileAddress t : tilesOf(changed)) {
    if (brush.reaches(middleOf(t), kHalfDiagonal)) undo.changed.insert(undo.changed.end(), t);
    co_yield brush.effort() * kTileSide;
  }
  std::set<std::uint32_t> open;
  co_yield addSmooths(boundsOf(undo.changed).wider(kMaxPasses), undo.edit, last_ + 1, undo, open);
  while (!open.empty()) {
    const std::uint64_t edit = compacted_ + open.extract(open.begin()).value();
    const Operation smooth = operation(edit);
    const Posts area = areaOf(smooth);
    std::uint64_t cost = kPostsOfRead;
    if (countsAfter(undo, edit) && meets(area.wider(marginOf(smooth)), undo.changed)) {
      changed.add(area);
      if (const Posts fresh = addTo(undo.changed, area); !fresh.empty())
        cost += addSmooths(fresh.wider(kMaxPasses), edit, last_ + 1, undo, open);
    }
    co_yield cost;
  }
}

// Backwards: what a smoothing reads must be right before it, and not after.
Turns History::findNeeded(Undoing& undo) const {
  if (undo.edit == 0) co_return;
  undo.needed = undo.changed;
  std::set<std::uint32_t> open;
  co_yield addSmooths(boundsOf(undo.needed), undo.from, last_ + 1, undo, open);
  while (!open.empty()) {
    const std::uint64_t edit = compacted_ + open.extract(std::prev(open.end())).value();
    const Operation smooth = operation(edit);
    const Posts area = areaOf(smooth);
    std::uint64_t cost = kPostsOfRead;
    if (countsAfter(undo, edit) && meets(area, undo.needed))
      if (const Posts fresh = addTo(undo.needed, area.wider(marginOf(smooth))); !fresh.empty())
        cost += addSmooths(fresh, undo.from, edit, undo, open);
    co_yield cost;
  }
}

Turns History::findAgain(Undoing& undo) const {
  if (undo.edit == 0) co_return;
  const Posts bounds = boundsOf(undo.needed);
  for (const AreaIndex* index : {&smooths_, &others_}) {
    const std::size_t looked = index->forEach(bounds, [&](std::uint32_t edit, const Posts&) {
      if (compacted_ + edit > undo.from && undo.again.size() <= undo.mostPosts / kPostsOfRead) undo.again.push_back(edit);
    });
    co_yield looked / 16;
  }
  std::ranges::sort(undo.again);
  co_yield undo.again.size();
  std::size_t kept = 0;
  for (const std::uint32_t edit : undo.again) {
    const Operation operation = this->operation(compacted_ + edit);
    if (countsAfter(undo, compacted_ + edit) && meets(areaOf(operation), undo.needed)) {
      undo.again[kept++] = edit;
      undo.cost += costToMake(operation, undo.needed);
    }
    co_yield costToRead(operation);
  }
  undo.again.resize(kept);
}

Turns History::makeAgain(const Undoing& undo, Made& made) {
  const auto start = std::ranges::find(checkpoints_, undo.from, &Checkpoint::edit);
  Draft draft(start == checkpoints_.end() ? base_ : start->layer);
  std::ranges::copy_if(checkpoints_, std::back_inserter(made.checkpoints), [&](const Checkpoint& c) { return c.edit >= undo.edit; });
  auto next = made.checkpoints.begin();
  for (const std::uint32_t edit : undo.again) {
    for (; next != made.checkpoints.end() && next->edit < compacted_ + edit; ++next)
      for (Turns turns = draft.copy(undo.changed, next->layer); const auto cost = turns.next();) co_yield *cost;
    const Operation operation = this->operation(compacted_ + edit);
    for (Turns turns = draft.apply(*terrain_, operation, &undo.needed, looked_); const auto cost = turns.next();) co_yield *cost;
    co_yield kPostsOfAgain + costToRead(operation);
  }
  for (; next != made.checkpoints.end(); ++next)
    for (Turns turns = draft.copy(undo.changed, next->layer); const auto cost = turns.next();) co_yield *cost;
  for (Turns turns = draft.copy(undo.changed, made.layer); const auto cost = turns.next();) co_yield *cost;
}

Turns History::undoing(std::uint64_t edit, std::uint64_t mostPosts, Made& made, Outcome<void>& fits) {
  Undoing undo;
  undo.mostPosts = mostPosts;
  for (Turns turns = findGround(edit, undo); undo.cost <= mostPosts;) {
    const auto cost = turns.next();
    if (!cost) break;
    undo.cost += *cost;
    co_yield *cost;
  }
  const auto before = std::ranges::find_if(checkpoints_.rbegin(), checkpoints_.rend(), [&](const auto& c) { return c.edit < undo.edit; });
  undo.from = before == checkpoints_.rend() ? compacted_ : before->edit;
  Turns plan[] = {findChanged(undo, made.changed), findNeeded(undo), findAgain(undo)};
  for (Turns& stage : plan)
    while (undo.cost <= mostPosts) {
      const auto cost = stage.next();
      if (!cost) break;
      undo.cost += *cost;
      co_yield *cost;
    }
  const auto after = static_cast<std::uint64_t>(std::ranges::count_if(checkpoints_, [&](const auto& c) { return c.edit >= undo.edit; }));
  undo.cost += after * undo.changed.size() * kTileSide;
  if (undo.cost > mostPosts) {
    fits = Error{"To undo edit " + std::to_string(edit) +
                 ", too many others would have to be made again; undo later ones there first, or change the ground by another edit."};
    co_return;
  }
  if (undo.edit == 0) co_return;
  for (Turns turns = makeAgain(undo, made); const auto cost = turns.next();) co_yield *cost;
}

bool History::isTimeForCheckpoint() const { return work_ - (checkpoints_.empty() ? 0 : checkpoints_.back().work) >= kCheckpointPosts; }

void History::addCheckpoint(std::uint64_t edit) {
  if (!isTimeForCheckpoint()) return;
  checkpoints_.push_back({edit, work_, layer_});
  for (std::size_t k = checkpoints_.size() - 1; k-- > 1;)
    if (work_ - checkpoints_[k - 1].work <= 2 * (work_ - checkpoints_[k + 1].work)) dropCheckpoint(k);
  boundCheckpoints(checkpoints_.size() < 2 ? 0 : checkpoints_.size() - 2);
}

void History::weighCheckpoint(std::size_t k) {
  checkpoints_[k].bytes = checkpoints_[k].layer->bytesBeside(k + 1 < checkpoints_.size() ? *checkpoints_[k + 1].layer : *layer_);
}

void History::dropCheckpoint(std::size_t k) {
  checkpoints_.erase(checkpoints_.begin() + static_cast<std::ptrdiff_t>(k));
  if (k > 0) weighCheckpoint(k - 1);
}

void History::boundCheckpoints(std::size_t from) {
  for (std::size_t k = from; k < checkpoints_.size(); ++k) weighCheckpoint(k);
  while (checkpointBytes() > kMaxCheckpointBytes) {
    const auto largest = std::ranges::max_element(checkpoints_, {}, &Checkpoint::bytes);
    dropCheckpoint(static_cast<std::size_t>(largest - checkpoints_.begin()));
  }
}

std::size_t History::checkpointBytes() const {
  std::size_t bytes = 0;
  for (const Checkpoint& c : checkpoints_) bytes += c.bytes;
  return bytes;
}

}  // namespace ridgecast::edits
