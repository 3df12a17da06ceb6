#include "server/session/edits.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <string>
#include <utility>

#include "common/edits/author.h"
#include "common/edits/edited_terrain.h"
#include "server/logging/logging.h"

namespace ridgecast::session {

namespace {

constexpr std::uint64_t kPostsATurn = 20'000;  // under a millisecond

constexpr lattice::Step kBeyond = 2 * lattice::kMaxPosition;
constexpr lattice::Area kEverywhere{-kBeyond, -kBeyond, kBeyond, kBeyond};

lattice::Area around(const lattice::Area& a, const lattice::Area& b) {
  return {std::min(a.x0, b.x0), std::min(a.z0, b.z0), std::max(a.x1, b.x1), std::max(a.z1, b.z1)};
}

Edits::Answer forNow(std::string sentence) {
  Edits::Answer out(Error{std::move(sentence)});
  out.isForNow = true;
  return out;
}

// `number`: of the edit that has the key; 0: it waits.
Edits::Answer ofAnother(std::uint64_t number) {
  return Error{"The key is that of another edit, " + (number > 0 ? "number " + std::to_string(number) : std::string("which waits")) +
               "; give this one a key of its own."};
}

Error over() { return {"The session has ended; join it again, and send the edit there."}; }

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

void Edits::ask(Edit edit, Done done, Pay pay) {
  if (!edit.key.empty()) edit.key = edit.author + '\n' + edit.key;
  std::optional<Answer> answer;
  {
    const std::lock_guard lock(mutex_);
    answer = atOnce(edit, static_cast<bool>(pay), done);
    if (!answer && done) {
      // Everybody waits for what is made.
      if (waiting_.empty()) pool_->post([self = shared_from_this()] { self->makeAll(); }, scheduling::Pool::Turn::kAhead);
      const auto& waits = waiting_.emplace_back(std::make_shared<Waiting>(std::move(edit), std::move(pay)));
      waits->done.push_back(std::exchange(done, nullptr));
      if (!waits->edit.key.empty()) open_[waits->edit.key] = waits;
    }
  }
  if (answer) done(*answer, 0);
}

std::optional<Edits::Answer> Edits::atOnce(const Edit& edit, bool pays, Done& done) {
  if (const auto open = open_.find(edit.key); open != open_.end()) {
    if (!edits::isMadeOf(edit.operation, open->second->edit.operation)) return ofAnother(0);
    open->second->done.push_back(std::exchange(done, nullptr));
    return {};
  }
  if (const auto made = keys_.find(edit.key); made != keys_.end()) {
    const std::uint64_t number = made->second;
    return edits::isMadeOf(edit.operation, made_[number - begins_ - 1].edit.operation) ? Answer(number) : ofAnother(number);
  }
  const auto isOwn = [client = edits::clientOf(edit.author)](const auto& w) { return w->pay && edits::clientOf(w->edit.author) == client; };
  if (pays && static_cast<std::size_t>(std::ranges::count_if(waiting_, isOwn)) >= kMostWaitingOfOne)
    return forNow("More than " + std::to_string(kMostWaitingOfOne) + " of your edits wait to be made; send it again in a moment.");
  if (waiting_.size() < kMostWaiting) return {};
  return forNow("More than " + std::to_string(kMostWaiting) + " edits of this session wait to be made; send it again in a moment.");
}

void Edits::read(std::uint64_t after, std::size_t most, Read read) {
  const std::lock_guard lock(mutex_);
  if (readings_.empty()) pool_->post([self = shared_from_this()] { self->readAll(); });
  readings_.push_back({after, most, std::move(read)});
}

bool Edits::isOver() const {
  const std::lock_guard lock(mutex_);
  return isOver_;
}

void Edits::end() {
  const std::lock_guard lock(mutex_);
  if (std::exchange(isOver_, true)) return;
  pool_->post([self = shared_from_this()] {
    self->kept_.log.reset();
    self->kept_.makeLog = nullptr;
    self->kept_.held.reset();
  });
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
  std::vector<std::shared_ptr<Waiting>> waiting, refused;
  {
    const std::lock_guard lock(mutex_);
    waiting.swap(waiting_);
    if (isOver_) waiting.swap(refused);
    for (const auto& w : refused) open_.erase(w->edit.key);
  }
  for (const auto& w : refused)
    for (const Done& done : w->done) done(over(), 0);
  const std::uint64_t before = history_.last();
  const auto layer = history_.layer();
  changedPosts_.clear();
  std::vector<MadeEdit> made;
  for (const auto& w : waiting) {
    const std::uint64_t looked = history_.looked();
    w->answer = make(*w, made);
    w->posts = history_.looked() - looked;
  }
  if (const auto isKept = keep(made, *layer); !isKept) {
    while (history_.last() > before) history_.takeBack(layer);
    for (const auto& w : waiting)
      if (w->answer && *w->answer > before) w->answer = Answer(isKept.error());
    made.clear();
  }
  if (noted_) std::ranges::for_each(made, noted_);
  {
    const std::lock_guard lock(mutex_);
    if (!made.empty()) ground_ = {std::make_shared<edits::EditedTerrain>(terrain_, history_.layer()), history_.last()};
    for (const MadeEdit& m : made) {
      areas_.push_back(m.ground);
      if (!m.edit.key.empty()) keys_[m.edit.key] = m.number;
    }
    std::ranges::move(made, std::back_inserter(made_));
    if (areas_.size() > kRecent) areas_.erase(areas_.begin(), areas_.end() - kRecent);
    for (const auto& w : waiting) open_.erase(w->edit.key);  // nobody joins any more
  }
  if (!made.empty()) changed_();
  for (const auto& w : waiting)
    for (const Done& done : w->done) done(w->answer, std::exchange(w->posts, 0));
}

std::optional<Edits::Answer> Edits::known(const Edit& edit) {
  if (edit.key.empty() || !kept_.log) return {};
  const auto sameOf = [&](std::uint64_t number) -> Outcome<bool> {
    const auto made = kept_.log->read(number - 1, 1);
    if (!made) return made.error();
    return !made->empty() && edits::isMadeOf(edit.operation, made->front().operation);
  };
  if (const auto number = kept_.log->numberOf(edit.key)) {
    const auto isSame = sameOf(*number);
    if (!isSame) return Answer(told(isSame.error()));
    return *isSame ? Answer(*number) : ofAnother(*number);
  }
  // In older logs a key was that of a name alone. Whose it was nobody knows: it is known again by its edit.
  const std::string former = edit.key.substr(edit.key.find('\n') + 1);
  if (former.find('\n') == former.npos) return {};
  if (const auto number = kept_.log->numberOf(former))
    if (const auto isSame = sameOf(*number); isSame && *isSame) return Answer(*number);
  return {};
}

Edits::Answer Edits::make(const Waiting& waiting, std::vector<MadeEdit>& made) {
  const Edit& edit = waiting.edit;
  if (const auto answer = known(edit)) return *answer;
  if (waiting.pay)
    if (auto paid = waiting.pay(edit.operation); !paid) return forNow(paid.error().message);
  auto making = history_.make(edit.operation, edits::kMostUndoPosts);
  while (!making.step(kPostsATurn))
    if (isOver()) return over();
  const auto& changed = making.result();
  if (!changed) return changed.error();
  changedPosts_.push_back(*changed);
  made.push_back({history_.last(), {edit.key, edit.author, history_.operation(history_.last())}, edits::groundOf(*changed)});
  return history_.last();
}

Outcome<void> Edits::keep(const std::vector<MadeEdit>& made, const edits::Layer& before) {
  if (made.empty()) return {};
  if (!kept_.log && kept_.makeLog) {
    auto log = kept_.makeLog();
    if (!log) return log.error();
    kept_.log = std::move(*log);
  }
  if (!kept_.log) return {};
  const std::int64_t now =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  std::vector<edit_log::Edit> entries;
  for (const MadeEdit& m : made) entries.push_back({m.number, m.edit.key, m.edit.author, now, m.edit.operation});
  auto appended = kept_.log->append(entries, before, *history_.layer(), changedPosts_);
  if (!appended) return told(appended.error());
  trouble_.clear();
  return appended;
}

Error Edits::told(Error e) {
  if (std::exchange(trouble_, e.message) != e.message)
    logging::error("in '" + kept_.log->file().parent_path().string() + "': " + e.message);
  return e;
}

Outcome<std::vector<MadeEdit>> Edits::list(std::uint64_t after, std::size_t most) {
  std::vector<MadeEdit> out;
  if (after < begins_) {
    if (!kept_.log) return over();
    auto edits = kept_.log->read(after, most);
    if (!edits) return told(edits.error());
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
