#include "server/session/edits.h"

#include <algorithm>
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

Edits::Edits(std::shared_ptr<const terrain::Terrain> terrain, scheduling::Executor* executor, std::function<void()> changed)
    : terrain_(std::move(terrain)), executor_(executor), changed_(std::move(changed)), history_(terrain_), ground_{terrain_, 0} {}

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
      waiting_.push_back({std::move(edit), std::move(done)});
      return begin();
    }
  }
  done(Error{"More than " + std::to_string(kMostWaiting) + " edits of this session wait to be made; send it again in a moment."});
}

void Edits::read(std::uint64_t after, std::size_t most, Read read) {
  const std::lock_guard lock(mutex_);
  readings_.push_back({after, most, std::move(read)});
  begin();
}

void Edits::begin() {
  if (!pool_) pool_ = executor_->makePool(1);
  if (!works_) works_ = pool_->post([self = shared_from_this()] { self->work(); });
}

void Edits::work() {
  std::vector<Waiting> waiting;
  std::vector<Reading> readings;
  {
    const std::lock_guard lock(mutex_);
    waiting.swap(waiting_);
    readings.swap(readings_);
  }
  const std::uint64_t before = history_.last();
  std::vector<Outcome<std::uint64_t>> numbers;
  numbers.reserve(waiting.size());
  for (Waiting& w : waiting) numbers.push_back(make(std::move(w.edit)));
  if (history_.last() > before) {
    const auto terrain = std::make_shared<edits::EditedTerrain>(terrain_, history_.layer());
    {
      const std::lock_guard lock(mutex_);
      ground_ = {terrain, history_.last()};
      for (std::uint64_t n = before; n < history_.last(); ++n) areas_.push_back(made_[n].ground);
      if (areas_.size() > kRecent) areas_.erase(areas_.begin(), areas_.end() - kRecent);
    }
    changed_();
  }
  for (std::size_t k = 0; k < waiting.size(); ++k) waiting[k].done(numbers[k]);
  for (const Reading& r : readings) {
    const std::size_t first = std::min<std::uint64_t>(r.after, made_.size()), count = std::min(r.most, made_.size() - first);
    const auto begin = made_.begin() + static_cast<std::ptrdiff_t>(first);
    r.read(std::vector<MadeEdit>(begin, begin + static_cast<std::ptrdiff_t>(count)));
  }
  const std::lock_guard lock(mutex_);
  works_ = false;
  if (!waiting_.empty() || !readings_.empty()) begin();
}

Outcome<std::uint64_t> Edits::make(Edit edit) {
  const std::string key = edit.key.empty() ? std::string() : edit.author + '\n' + edit.key;
  if (const auto known = keys_.find(key); !key.empty() && known != keys_.end()) return known->second;
  auto prepared = history_.prepare(std::move(edit.operation));
  if (!prepared) return prepared.error();
  edit.operation = std::move(*prepared);
  const auto changed = history_.add(edit.operation);
  if (!changed) return changed.error();
  if (!key.empty()) keys_[key] = history_.last();
  made_.push_back({history_.last(), std::move(edit), edits::groundOf(*changed)});
  return history_.last();
}

}  // namespace ridgecast::session
