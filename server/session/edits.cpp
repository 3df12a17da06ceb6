#include "server/session/edits.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

#include "common/edits/edited_terrain.h"

namespace ridgecast::session {

namespace {

constexpr lattice::Step kBeyond = 2 * lattice::kMaxPosition;
constexpr lattice::Area kEverywhere{-kBeyond, -kBeyond, kBeyond, kBeyond};

lattice::Area around(const lattice::Area& a, const lattice::Area& b) {
  return {std::min(a.x0, b.x0), std::min(a.z0, b.z0), std::max(a.x1, b.x1), std::max(a.z1, b.z1)};
}

}  // namespace

Edits::Edits(std::shared_ptr<const terrain::Terrain> terrain, scheduling::Executor* executor, std::function<void()> changed, Kept kept,
             Made made)
    : terrain_(std::move(terrain)),
      pool_(executor->makePool(1)),
      changed_(std::move(changed)),
      noted_(std::move(made)),
      kept_(std::move(kept)),
      history_(kept_.history ? std::move(*kept_.history) : edits::History(terrain_)),
      begins_(history_.last()),
      ground_{begins_ == 0 ? terrain_ : std::make_shared<edits::EditedTerrain>(terrain_, history_.layer()), begins_} {
  kept_.history.reset();
}

Ground Edits::ground() const {
  const std::lock_guard lock(mutex_);
  return ground_;
}

Edits::News Edits::since(std::uint64_t edit) const {
  const std::lock_guard lock(mutex_);
  News news{ground_, {}};
  const std::uint64_t missed = ground_.edit - std::min(edit, ground_.edit);
  if (missed > areas_.size()) {
    news.changed = {kEverywhere};
    return news;
  }
  for (auto area = areas_.end() - static_cast<std::ptrdiff_t>(missed); area != areas_.end(); ++area) {
    if (news.changed.size() < kMostAreas)
      news.changed.push_back(*area);
    else
      news.changed.back() = around(news.changed.back(), *area);
  }
  return news;
}

void Edits::ask(Edit edit, Done done) {
  {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() < kMostWaiting) {
      // Everybody waits for what is made.
      if (waiting_.empty()) pool_->post([self = shared_from_this()] { self->makeAll(); }, scheduling::Pool::Turn::kAhead);
      waiting_.push_back({std::move(edit), std::move(done)});
      return;
    }
  }
  done(Error{"More than " + std::to_string(kMostWaiting) + " edits of this session wait to be made; send it again in a moment."}, 0);
}

void Edits::read(std::uint64_t after, std::size_t most, Read read) {
  const std::lock_guard lock(mutex_);
  if (readings_.empty()) pool_->post([self = shared_from_this()] { self->readAll(); });
  readings_.push_back({after, most, std::move(read)});
}

void Edits::readAll() {
  std::vector<Reading> readings;
  {
    const std::lock_guard lock(mutex_);
    readings.swap(readings_);
  }
  for (const Reading& r : readings) r.read(list(r.after, r.most));
}

void Edits::makeAll() {
  std::vector<Waiting> waiting;
  {
    const std::lock_guard lock(mutex_);
    waiting.swap(waiting_);
  }
  const std::uint64_t before = history_.last();
  const auto layer = history_.layer();
  changedPosts_.clear();
  std::vector<Outcome<std::uint64_t>> numbers;
  std::vector<std::uint64_t> posts;
  for (Waiting& w : waiting) {
    const std::uint64_t looked = history_.looked();
    numbers.push_back(make(std::move(w.edit)));
    posts.push_back(history_.looked() - looked);
  }
  if (history_.last() > before) {
    if (const auto isKept = keep(before, *layer); !isKept) {
      while (history_.last() > before) {
        std::erase_if(keys_, [&](const auto& key) { return key.second == history_.last(); });
        made_.pop_back();
        history_.takeBack(layer);
      }
      for (Outcome<std::uint64_t>& number : numbers)
        if (number && *number > before) number = isKept.error();
    } else {
      for (std::uint64_t n = before; noted_ && n < history_.last(); ++n) noted_(made_[n - begins_]);
      {
        const std::lock_guard lock(mutex_);
        ground_ = {std::make_shared<edits::EditedTerrain>(terrain_, history_.layer()), history_.last()};
        for (std::uint64_t n = before; n < history_.last(); ++n) areas_.push_back(made_[n - begins_].ground);
        if (areas_.size() > kRecent) areas_.erase(areas_.begin(), areas_.end() - kRecent);
      }
      changed_();
    }
  }
  for (std::size_t k = 0; k < waiting.size(); ++k) waiting[k].done(numbers[k], posts[k]);
}

Outcome<std::uint64_t> Edits::make(Edit edit) {
  if (!edit.key.empty()) {
    edit.key = edit.author + '\n' + edit.key;
    if (const auto known = keys_.find(edit.key); known != keys_.end()) return known->second;
    if (kept_.log)
      if (const auto known = kept_.log->numberOf(edit.key)) return *known;
  }
  auto prepared = history_.prepare(std::move(edit.operation));
  if (!prepared) return prepared.error();
  edit.operation = std::move(*prepared);
  const auto changed = history_.add(edit.operation);
  if (!changed) return changed.error();
  changedPosts_.push_back(*changed);
  if (!edit.key.empty()) keys_[edit.key] = history_.last();
  made_.push_back({history_.last(), std::move(edit), edits::groundOf(*changed)});
  return history_.last();
}

Outcome<void> Edits::keep(std::uint64_t before, const edits::Layer& layer) {
  if (!kept_.log && kept_.makeLog) {
    auto made = kept_.makeLog();
    if (!made) return made.error();
    kept_.log = std::move(*made);
  }
  if (!kept_.log) return {};
  const std::int64_t now =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  std::vector<edit_log::Edit> entries;
  for (std::uint64_t n = before; n < history_.last(); ++n) {
    const MadeEdit& made = made_[n - begins_];
    entries.push_back({made.number, made.edit.key, made.edit.author, now, made.edit.operation});
  }
  return kept_.log->append(entries, layer, *history_.layer(), changedPosts_);
}

Outcome<std::vector<MadeEdit>> Edits::list(std::uint64_t after, std::size_t most) {
  std::vector<MadeEdit> out;
  if (kept_.log && after < begins_) {
    auto edits = kept_.log->read(after, most);
    if (!edits) return edits.error();
    for (edit_log::Edit& e : *edits) {
      const edits::Posts posts = edits::areaOf(e.operation);
      out.push_back({e.number,
                     {std::move(e.key), std::move(e.author), std::move(e.operation)},
                     posts.empty() ? kEverywhere : edits::groundOf(posts)});
    }
    return out;
  }
  for (std::uint64_t n = std::max(after, begins_) - begins_; n < made_.size() && out.size() < most; ++n) out.push_back(made_[n]);
  return out;
}

}  // namespace ridgecast::session
