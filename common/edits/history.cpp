#include "common/edits/history.h"

#include <algorithm>
#include <utility>

#include "common/edits/draft.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"

namespace ridgecast::edits {
namespace {

constexpr std::uint64_t kPostsOfEdit = 256;  // of work, besides those that it looks at
constexpr std::size_t kMaxCheckpoints = 64;  // for those of 4 million edits, however wide

}  // namespace

History::History(std::shared_ptr<const terrain::Terrain> terrain, std::size_t mostBytes)
    : terrain_(std::move(terrain)), mostBytes_(mostBytes) {
  checkpoints_.reserve(kMaxCheckpoints);
}

Operation History::operation(std::uint64_t edit) const { return unpack(packed(edit)).value(); }

Outcome<Operation> History::prepare(Operation operation) {
  Outcome<void> fits;
  for (Turns turns = preparing(operation, fits); turns.next();) {
  }
  if (!fits) return fits.error();
  return operation;
}

Turns History::preparing(Operation& operation, Outcome<void>& fits) {
  fits = check(operation);
  if (!fits) co_return;
  if (const auto* undo = std::get_if<Undo>(&operation.what)) {
    if (undo->edit > last())
      fits = Error{"There is no edit " + std::to_string(undo->edit) + " to undo; the last is " + std::to_string(last()) + "."};
    else if (undo->edit <= compacted_)
      fits = Error{"Edit " + std::to_string(undo->edit) + " was compacted and cannot be undone."};
    if (!fits) co_return;
    for (Turns turns = reading(fits); const auto cost = turns.next();) co_yield *cost;
    if (fits && isUndone(undo->edit))
      fits = Error{"Edit " + std::to_string(undo->edit) + " is undone already; undo the edit that undid it to have it back."};
  }
  if (const auto* road = std::get_if<Road>(&operation.what); road && !road->surveyed) {
    std::vector<lattice::Step> x, z;
    for (const lattice::Point p : stationsOf(*road)) {
      x.push_back(p.x);
      z.push_back(p.z);
    }
    if (x.size() > kMaxStations) {
      fits = Error{"A road's corners and the stations between them are " + std::to_string(x.size()) + "; the most is " +
                   std::to_string(kMaxStations) + ": leave corners out."};
      co_return;
    }
    std::vector<std::int32_t> ground(x.size());
    EditedTerrain(terrain_, layer_).heightSteps(x, z, ground);
    operation.what = survey(*road, ground);
  }
}

bool History::Making::step(std::uint64_t posts) {
  for (std::uint64_t done = 0; const auto cost = turns_.next();)
    if (done += *cost; done >= posts) return false;
  return true;
}

History::Making History::make(Operation operation, std::uint64_t mostUndoPosts) {
  auto result = std::make_unique<Outcome<Posts>>();
  Outcome<Posts>& to = *result;
  return {std::move(result), making(std::move(operation), mostUndoPosts, to)};
}

Outcome<Posts> History::add(Operation operation) {
  Making making = make(std::move(operation));
  while (!making.step(std::numeric_limits<std::uint64_t>::max())) {
  }
  return making.result();
}

Turns History::making(Operation operation, std::uint64_t mostUndoPosts, Outcome<Posts>& result) {
  [[maybe_unused]] const std::uint64_t before = last_;
  Outcome<void> fits;
  for (Turns turns = preparing(operation, fits); const auto cost = turns.next();) co_yield *cost;
  if (fits && last_ - compacted_ >= kMaxEdits)
    fits = Error{"A session has at most " + std::to_string(kMaxEdits) +
                 " edits; its operator can join them with `ridgecast-server edits compact`."};
  Made made{layer_, {}, areaOf(operation)};
  const std::uint64_t looked = looked_;
  const auto* const undo = std::get_if<Undo>(&operation.what);
  if (fits && undo) {
    for (Turns turns = undoing(undo->edit, mostUndoPosts, made, fits); const auto cost = turns.next();) co_yield *cost;
  } else if (fits) {
    Draft draft(layer_);
    for (Turns turns = draft.apply(*terrain_, operation, nullptr, looked_); const auto cost = turns.next();) co_yield *cost;
    const TileSet written = draft.written();
    for (Turns turns = draft.copy(written, made.layer); const auto cost = turns.next();) co_yield *cost;
  }
  if (fits && made.layer->bytes() > mostBytes_ && made.layer->bytes() > layer_->bytes())
    fits = Error{"The session's edits take " + std::to_string(mostBytes_ >> 20) +
                 " MiB, which is the most: undo some, or edit where there are edits already."};
  if (!fits) {
    result = fits.error();
    co_return;
  }
  expects(before == last_, "edits are made one after the other");
  result = made.changed;
  commit(operation, std::move(made));
  work_ += kPostsOfEdit + (undo ? 0 : looked_ - looked);
  addCheckpoint(last_);
}

void History::commit(const Operation& operation, Made made) {
  const auto* const undo = std::get_if<Undo>(&operation.what);
  entries_.add(pack(operation));
  try {
    file(last_ + 1, operation);
  } catch (...) {
    entries_.removeLast();
    throw;
  }
  ++last_;
  layer_ = std::move(made.layer);
  if (!undo) return;
  addUndos(undo->edit, 1);
  std::ranges::move(made.checkpoints, checkpoints_.end() - static_cast<std::ptrdiff_t>(made.checkpoints.size()));
  boundCheckpoints(0);
}

void History::file(std::uint64_t edit, const Operation& operation) {
  if (const Posts area = areaOf(operation); !area.empty()) indexFor(operation).add(static_cast<std::uint32_t>(edit - compacted_), area);
}

void History::takeBack(std::shared_ptr<const Layer> before) {
  const Operation last = operation(last_);
  if (const Posts area = areaOf(last); !area.empty()) indexFor(last).remove(static_cast<std::uint32_t>(last_ - compacted_), area);
  expects(last_ > compacted_, "an edit that is taken back is there");
  entries_.removeLast();
  --last_;
  std::uint64_t right = last_;  // the last edit whose ground is in a checkpoint as it is now
  if (const auto* undo = std::get_if<Undo>(&last.what))
    if (const std::uint64_t edit = addUndos(undo->edit, -1); edit != 0) right = edit - 1;
  std::erase_if(checkpoints_, [&](const Checkpoint& c) { return c.edit > right; });
  layer_ = std::move(before);
}

void History::restore(std::uint64_t compacted, std::uint64_t last, std::shared_ptr<const Layer> layer, Read read) {
  expects(compacted <= last, "compacted edits are no more than all");
  *this = History(std::move(terrain_), mostBytes_);
  compacted_ = compacted;
  last_ = last;
  layer_ = std::move(layer);
  read_ = std::move(read);
  if (layer_) checkpoints_.push_back({last_, work_, layer_});
}

Turns History::reading(Outcome<void>& done) {
  while (read_) {
    const std::uint64_t wanted = last_ - compacted_ - entries_.size(), before = past_.size();
    auto some = read_(compacted_ + before);
    if (!some) {
      done = some.error();
      co_return;
    }
    if (before == 0) base_ = std::move(some->base);
    const std::size_t count = some->operations.size();
    if (before + count > wanted || (count == 0 && before < wanted))
      done = Error{"The log holds " + std::to_string(before + count) + " edits where there should be " + std::to_string(wanted) + "."};
    else
      done = addPast(some->operations);
    if (!done) co_return;
    if (past_.size() == wanted) joinPast();
    co_yield kPostsOfEdit*(count + 1);
  }
}

Outcome<void> History::addPast(const std::vector<Operation>& operations) {
  for (const Operation& o : operations) {
    const std::uint64_t number = compacted_ + past_.size() + 1;
    if (const auto* undo = std::get_if<Undo>(&o.what); undo && (undo->edit <= compacted_ || undo->edit >= number))
      return Error{"Edit " + std::to_string(number) + " of the log undoes edit " + std::to_string(undo->edit) +
                   ", which is not there before it."};
    past_.add(pack(o));
    try {
      file(number, o);
    } catch (...) {
      past_.removeLast();
      throw;
    }
  }
  return {};
}

void History::joinPast() {
  const std::size_t read = past_.size();
  try {
    for (std::size_t k = 0; k < entries_.size(); ++k) past_.add(entries_.packed(k), entries_.undos(k));
  } catch (...) {
    while (past_.size() > read) past_.removeLast();
    throw;
  }
  entries_ = std::exchange(past_, {});
  read_ = nullptr;
  // The last first: whether it counts is then known.
  for (std::size_t k = entries_.size(); k-- > 0;)
    if (const std::uint64_t edit = undoneBy(entries_.packed(k)); edit != 0 && entries_.undos(k) == 0) ++entries_.undos(indexOf(edit));
}

Outcome<void> History::replay() {
  Outcome<void> all;
  for (Turns turns = reading(all); turns.next();) {
  }
  if (!all) return all;
  checkpoints_.clear();
  layer_ = base_;
  work_ = 0;
  Draft draft(layer_);
  for (std::uint64_t edit = compacted_ + 1; edit <= last_; ++edit) {
    const std::uint64_t looked = looked_;
    if (counts(edit)) {
      const Operation operation = this->operation(edit);
      for (Turns turns = draft.apply(*terrain_, operation, nullptr, looked_); turns.next();) {
      }
    }
    work_ += kPostsOfEdit + looked_ - looked;
    if (edit < last_ && !isTimeForCheckpoint()) continue;
    const TileSet written = draft.written();
    for (Turns turns = draft.copy(written, layer_); turns.next();) {
    }
    draft = Draft(layer_);
    addCheckpoint(edit);
  }
  return {};
}

}  // namespace ridgecast::edits
