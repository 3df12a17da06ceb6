#include "server/editing/edits.h"

#include <algorithm>
#include <new>
#include <string>
#include <utility>

#include "common/edits/author.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "server/edit_log/entry.h"
#include "server/logging/logging.h"

namespace ridgecast::editing {

namespace {

lattice::Area around(const lattice::Area& a, const lattice::Area& b) {
  return {std::min(a.x0, b.x0), std::min(a.z0, b.z0), std::max(a.x1, b.x1), std::max(a.z1, b.z1)};
}

Edits::Answer early(std::string sentence) { return Edits::refusal(Edits::Answer::Why::kEarly, std::move(sentence)); }
Edits::Answer full(std::string sentence) { return Edits::refusal(Edits::Answer::Why::kFull, std::move(sentence)); }

// `number`: of the edit that has the key; 0: it waits.
Edits::Answer ofAnother(std::uint64_t number) {
  return Error{"The key is that of another edit, " + (number > 0 ? "number " + std::to_string(number) : std::string("which waits")) +
               "; give this one a key of its own."};
}

Edits::Answer outOfMemory() {
  return full("The server ran out of memory at this edit, and has not made it; send a smaller one, or send it later.");
}

bool hasLast(const Edits::Kept& kept) { return kept.store && kept.store->last() > kept.store->compacted(); }
// None: there is none, or it was compacted, or it cannot be read.
std::optional<std::uint64_t> identityOfLast(const Edits::Kept& kept) {
  if (!hasLast(kept)) return {};
  const auto last = kept.store->read(kept.store->last() - 1, 0);
  return last ? std::optional(edit_log::identityOf(last->front())) : std::nullopt;
}

std::string mebibytes(std::uint64_t bytes) { return std::to_string(bytes >> 20) + " MiB"; }

// Whether the one is what becomes of the other.
bool isMadeOf(const Applied& asked, const Applied& made) {
  if (asked.operation == made.operation) return true;
  const auto a = edits::unpack(asked.operation), b = edits::unpack(made.operation);
  return a && b && edits::isMadeOf(*a, *b);
}

}  // namespace

Edits::Edits(std::shared_ptr<const terrain::Terrain> terrain, scheduling::Executor& executor, scheduling::Executor& disk,
             std::shared_ptr<EditSpace> space, std::function<void()> changed, Kept kept, Made made, std::chrono::milliseconds turn,
             EditOrder::Shared shared)
    : pool_(executor.makePool(1)),
      disk_(disk.makePool(1)),
      space_(std::move(space)),
      changed_(std::move(changed)),
      noted_(std::move(made)),
      turn_(turn),
      left_(kept.left),
      kept_(std::move(kept)),
      history_(kept_.history ? std::move(*kept_.history) : edits::History(std::move(terrain))),
      compacted_(history_.compacted()),
      bytes_(kept_.store ? kept_.store->bytes() : 0),
      order_(std::make_shared<EditOrder>(shared, history_.last(), shared.bus->server() != 0 ? identityOfLast(kept_) : std::nullopt)),
      check_(order_->isShared() ? std::make_shared<GroundCheck>(shared.bus, shared.log, executor) : nullptr),
      ground_{history_.last() == 0 ? history_.terrain() : std::make_shared<edits::EditedTerrain>(history_.terrain(), history_.layer()),
              history_.last()} {
  expects(!kept_.store || kept_.store->last() == ground_.edit, "a session begins with all edits of its store");
  kept_.history.reset();
  space_->kept.take(bytes_, ~std::uint64_t{0});
  if (!order_->isShared()) return;
  ground_.identity = identityOfLast(kept_).value_or(0);
  if (hasLast(kept_) && ground_.identity == 0) {
    logging::error(kept_.folder + "The last edit cannot be read, so that the session cannot follow other servers; check the log.");
    stopped_ = kCannotFollow;
  }
  auto copy = std::make_unique<EditCopy>(std::move(kept_.store), kept_.makeStore,
                                         [folder = kept_.folder, said = std::string()](const std::string& what, bool isGood) mutable {
                                           if (std::exchange(said, what) == what) return;
                                           isGood ? logging::info(folder + what) : logging::error(folder + what);
                                         });
  copy_ = copy.get();
  kept_.store = std::move(copy);
}

Edits::~Edits() {
  space_->kept.give(bytes_);
  for (const auto& w : waiting_) space_->waiting.give(w->asked.bytes());
}

Edits::Answer Edits::refusal(Answer::Why why, std::string sentence) {
  Answer out(Error{std::move(sentence)});
  out.why = why;
  return out;
}

Edits::Answer Edits::over() { return refusal(Answer::Why::kOver, "The session has ended; join it again, and send the edit there."); }

Edits::Answer Edits::away() {
  return refusal(Answer::Why::kEarly,
                 "The other servers of this session cannot be reached, so the edit was not made; send it again in a moment, with its key.");
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
    news.changed = {edit_store::kEverywhere};
    return news;
  }
  for (auto area = areas_.end() - static_cast<std::ptrdiff_t>(missed); area != areas_.end(); ++area) {
    if (news.changed.size() < kMaxAreas)
      news.changed.push_back(*area);
    else
      news.changed.back() = around(news.changed.back(), *area);
  }
  return news;
}

// ---- what waits ----

void Edits::ask(Edit edit, Done done, Pay pay) {
  expects(done && edit.key.find('\n') == edit.key.npos, "an edit is answered, and its key ends where it ends");
  Applied asked;
  if (!edit.key.empty()) asked.key = edit.author + '\n' + edit.key;
  asked.author = std::move(edit.author);
  asked.operation = edits::pack(edit.operation);
  std::optional<Answer> answer;
  {
    const std::lock_guard lock(mutex_);
    answer = atOnce(asked, static_cast<bool>(pay), done);
    if (!answer && done) {
      const auto& waits = waiting_.emplace_back(std::make_shared<Waiting>(std::move(asked), std::move(pay)));
      waits->done.push_back(std::exchange(done, nullptr));
      if (!waits->asked.key.empty()) open_[waits->asked.key] = waits;
      if (std::exchange(state_, State::kBusy) == State::kRests) proceed();
    }
  }
  if (answer) done(*answer, 0);
}

std::optional<Edits::Answer> Edits::atOnce(const Applied& asked, bool pays, Done& done) {
  if (state_ == State::kOver) return over();
  if (const auto open = open_.find(asked.key); open != open_.end()) {
    if (!isMadeOf(asked, open->second->asked)) return ofAnother(0);
    open->second->done.push_back(std::exchange(done, nullptr));
    return {};
  }
  if (!stopped_.empty()) return full(stopped_);
  if (order_->isAway()) return away();
  std::uint64_t own = 0, ownBytes = asked.bytes(), allBytes = asked.bytes();
  for (const auto& w : waiting_) {
    allBytes += w->asked.bytes();
    if (w->pay && edits::clientOf(w->asked.author) == edits::clientOf(asked.author)) ++own, ownBytes += w->asked.bytes();
  }
  const EditSpace::Limits& limits = space_->limits;
  if (pays && own >= kMaxWaitingOfOne)
    return early("More than " + std::to_string(kMaxWaitingOfOne) + " of your edits wait to be made; send it again in a moment.");
  if (pays && ownBytes > limits.waiting / 2)
    return early("More than " + mebibytes(limits.waiting / 2) + " of your edits wait to be made; send it again in a moment.");
  if (waiting_.size() >= kMaxWaiting)
    return early("More than " + std::to_string(kMaxWaiting) + " edits of this session wait to be made; send it again in a moment.");
  if (allBytes > limits.waiting)
    return early("More than " + mebibytes(limits.waiting) + " of edits of this session wait to be made; send it again in a moment.");
  if (!space_->waiting.take(asked.bytes(), limits.allWaiting))
    return early("More than " + mebibytes(limits.allWaiting) + " of this server's edits wait to be made; send it again in a moment.");
  return {};
}

bool Edits::isOver() const {
  const std::lock_guard lock(mutex_);
  return state_ == State::kOver;
}

void Edits::end() {
  order_->end();
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(state_, State::kOver) != State::kRests) return;  // a group's last step goes on
  }
  goOn();
}

// ---- a group ----

void Edits::lookUp() {
  {
    const std::lock_guard lock(mutex_);
    group_.assign(waiting_.begin(), waiting_.end());
  }
  for (const auto& w : group_) {
    try {
      w->answer = known(w->asked);
    } catch (const std::bad_alloc&) {
      w->answer = outOfMemory();
    }
  }
  pool_->post([self = shared_from_this()] { self->make(); });
}

std::optional<Edits::Answer> Edits::known(const Applied& asked) {
  if (asked.key.empty() || !kept_.store) return {};
  if (auto kept = keptWith(asked.key, asked)) return kept;
  // In older logs a key was that of a name alone. Whose it was nobody knows: it is known again by its edit.
  const std::string former = asked.key.substr(asked.key.find('\n'));
  if (former.find('\n', 1) == former.npos) return {};
  auto older = keptWith(former, asked);
  return older && *older ? older : std::nullopt;
}

std::optional<Edits::Answer> Edits::keptWith(const std::string& key, const Applied& asked) {
  expects(!key.empty(), "an edit without a key is not known again");
  const auto number = kept_.store->numberOf(key);
  if (!number) return full(told(number.error()).message);
  if (!*number) return {};
  const auto made = kept_.store->read(**number - 1, 0);
  if (!made) return full(told(made.error()).message);
  return !made->empty() && isMadeOf(asked, made->front()) ? Answer(**number) : ofAnother(**number);
}

void Edits::make() {
  expects(batch_.done <= group_.size(), "a batch is of its group");
  if (isOver()) {
    batch_.making.reset();
    return goOn();
  }
  if (order_->isBehind()) {
    makeAgain();
    return goOn();
  }
  if (batch_.made.empty() && !batch_.making) batch_.before = history_.layer();
  const auto begun = std::chrono::steady_clock::now();
  const auto worked = [&] { return std::chrono::steady_clock::now() - begun; };
  bool isGroup = false;
  while (batch_.done < group_.size() && !isGroup && worked() < turn_) {
    Waiting& w = *group_[batch_.done];
    // An undo may take long, and those before it do not wait for it.
    isGroup = !w.answer && !batch_.making && !batch_.made.empty() &&
              (batch_.worked + worked() >= kGroupTurns * turn_ || edits::undoneBy(w.asked.operation) > 0);
    if (!isGroup && (w.answer || step(w))) ++batch_.done;
  }
  batch_.worked += worked();
  if (batch_.done < group_.size() && !isGroup) {
    pool_->post([self = shared_from_this()] { self->make(); });
    return;
  }
  try {
    if (!batch_.made.empty()) batch_.next = {std::make_shared<edits::EditedTerrain>(history_.terrain(), history_.layer()), history_.last()};
  } catch (const std::bad_alloc&) {
    refuseMade(outOfMemory());
  }
  if (!batch_.made.empty()) return append();
  confirm();
}

// The first edit of all begins this server's copy: where there may be none, it is refused before it is made everywhere.
void Edits::append() {
  const auto go = [self = shared_from_this()] {
    self->order_->append(self->batch_.made, [self](EditOrder::Decided decided) { self->appended(std::move(decided)); });
  };
  if (!order_->isShared() || batch_.made.front().number > 1) return go();
  disk_->post([self = shared_from_this(), go] {
    if (auto ready = self->copy_->prepare(edits::clientOf(self->batch_.made.front().author)); !ready)
      return self->appended({EditOrder::Decided::Kind::kFull, 0, self->told(ready.error()).message});
    go();
  });
}

void Edits::appended(EditOrder::Decided decided) {
  if (decided.kind == EditOrder::Decided::Kind::kDone) {
    disk_->post([self = shared_from_this()] { self->keep(); });
    return;
  }
  pool_->post([self = shared_from_this(), decided = std::move(decided)] { self->notAppended(decided); });
}

bool Edits::step(Waiting& waiting) {
  try {
    if (!batch_.making) waiting.answer = begin(waiting);
    constexpr std::uint64_t kPosts = 1u << 14;  // half a millisecond
    if (!waiting.answer && batch_.making->making.step(kPosts)) waiting.answer = finish(waiting);
  } catch (const std::bad_alloc&) {
    if (batch_.making && history_.last() > batch_.making->last) history_.takeBack(batch_.making->before);
    waiting.answer = outOfMemory();
  }
  if (waiting.answer) batch_.making.reset();
  return waiting.answer.has_value();
}

std::optional<Edits::Answer> Edits::begin(Waiting& waiting) {
  expects(!batch_.making, "one edit is made at a time");
  const EditSpace::Limits& limits = space_->limits;
  const std::uint64_t bytes = waiting.asked.bytes();
  auto operation = edits::unpack(waiting.asked.operation).value();
  if (bytes_ + bytes > limits.session)
    return full("This session's edits have " + mebibytes(limits.session) +
                ", which is the most; its operator can join them with `ridgecast-server edits compact`.");
  if (space_->kept.used() + bytes > limits.server)
    return full("The edits of this server's sessions have " + mebibytes(limits.server) +
                ", which is the most; send it again when a session has ended.");
  if (waiting.pay && !waiting.isPaid)
    if (auto paid = waiting.pay(operation, bytes); !paid) return early(paid.error().message);
  waiting.isPaid = true;
  batch_.made.reserve(batch_.made.size() + 1);
  batch_.changed.reserve(batch_.made.size() + 1);
  const std::uint64_t most = waiting.pay ? edits::kMaxUndoPosts : ~std::uint64_t{0};
  batch_.making = std::make_unique<Making>(history_.make(std::move(operation), most), history_.layer(), history_.last(), history_.looked());
  return {};
}

Edits::Answer Edits::finish(Waiting& waiting) {
  waiting.posts = history_.looked() - batch_.making->looked;
  const auto& changed = batch_.making->making.result();
  if (!changed) return changed.error();
  using namespace std::chrono;
  Applied applied = waiting.asked;
  applied.number = history_.last();
  applied.time = duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
  expects(batch_.made.empty() || applied.number == batch_.made.back().number + 1, "edits of a group follow one another");
  applied.operation = history_.packed(applied.number);
  applied.ground = edits::groundOf(*changed);
  if (check_ && applied.number % GroundCheck::kEvery == 0) batch_.checked.emplace_back(batch_.made.size(), history_.layer());
  batch_.changed.push_back(*changed);  // the last that may run out of memory
  count(applied);
  batch_.made.push_back(std::move(applied));
  return history_.last();
}

void Edits::count(const Applied& made) {
  bytes_ += made.bytes();
  space_->kept.take(made.bytes(), ~std::uint64_t{0});
}

void Edits::keep() {
  try {
    batch_.isKept = store();
  } catch (const std::bad_alloc&) {
    batch_.isKept = outOfMemory().error();
  }
  pool_->post([self = shared_from_this()] { self->publish(); });
}

Outcome<void> Edits::store() {
  expects(!batch_.made.empty() && batch_.before && batch_.changed.size() == batch_.made.size(),
          "what is written was made, on known ground");
  if (!kept_.store) {
    auto store = kept_.makeStore(edits::clientOf(batch_.made.front().author));
    if (!store) return store.error();
    kept_.store = std::move(*store);
  }
  auto appended = kept_.store->append(batch_.made, {*batch_.before, *history_.layer(), batch_.changed});
  if (!appended) return told(appended.error());
  trouble_.clear();
  return appended;
}

Error Edits::told(Error e) {
  if (std::exchange(trouble_, e.message) != e.message) logging::error(kept_.folder + e.message);
  return e;
}

void Edits::refuseMade(const Answer& why) {
  const std::uint64_t before = batch_.made.front().number - 1;
  takeBack();
  for (std::size_t k = 0; k < batch_.done; ++k)
    if (auto& answer = group_[k]->answer; *answer && **answer > before) answer = why;
}

void Edits::takeBack() {
  expects(!batch_.made.empty() && batch_.before, "what is taken back was made");
  const std::uint64_t before = batch_.made.front().number - 1;
  for (const Applied& m : batch_.made) {
    space_->kept.give(m.bytes());
    expects(bytes_ >= m.bytes(), "a session's edits are counted");
    bytes_ -= m.bytes();
  }
  while (history_.last() > before) history_.takeBack(batch_.before);
  batch_.made.clear();
  batch_.checked.clear();
}

void Edits::publish() {
  expects(batch_.done <= group_.size(), "what is done is of the group");
  // With other servers the edits are made, whatever becomes of this one's copy.
  if (!batch_.made.empty() && !batch_.isKept && !order_->isShared()) refuseMade(full(batch_.isKept.error().message));
  if (noted_) std::ranges::for_each(batch_.made, noted_);
  {
    const std::lock_guard lock(mutex_);
    expects(batch_.made.empty() || (batch_.made.front().number == ground_.edit + 1 && batch_.made.back().number == batch_.next.edit),
            "new ground is that of the edits after the last");
    if (!batch_.made.empty()) {
      ground_ = std::move(batch_.next);
      if (order_->isShared()) ground_.identity = edit_log::identityOf(batch_.made.back());
    }
    for (const Applied& m : batch_.made) areas_.push_back(m.ground);
    if (areas_.size() > kRecent) areas_.erase(areas_.begin(), areas_.end() - kRecent);
    expects(waiting_.size() >= group_.size() && std::equal(group_.begin(), group_.end(), waiting_.begin()),
            "a group is what waits in front");
    for (std::size_t k = 0; k < batch_.done; ++k) open_.erase(group_[k]->asked.key);  // nobody joins any more
    for (std::size_t k = 0; k < batch_.done; ++k) space_->waiting.give(group_[k]->asked.bytes());
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(batch_.done));
  }
  if (!batch_.made.empty()) changed_();
  for (std::size_t k = 0; k < batch_.done; ++k) {
    Waiting& w = *group_[k];
    expects(w.answer.has_value(), "an edit that is done has its answer");
    for (const Done& done : w.done) done(*w.answer, std::exchange(w.posts, 0));
  }
  group_.erase(group_.begin(), group_.begin() + static_cast<std::ptrdiff_t>(batch_.done));
  if (!batch_.made.empty()) order_->applied(batch_.made.back());
  for (auto& [k, layer] : batch_.checked) check_->add(batch_.made[k].number, edit_log::identityOf(batch_.made[k]), std::move(layer));
  const Outcome<void> isKept = std::move(batch_.isKept);
  batch_ = {};
  if (!isKept && order_->isShared()) return leave(isKept.error().message, false);
  goOn();
}

void Edits::goOn() {
  std::deque<std::shared_ptr<Waiting>> refused;
  {
    const std::lock_guard lock(mutex_);
    if (state_ == State::kOver) {
      refused.swap(waiting_);
      for (const auto& w : refused) space_->waiting.give(w->asked.bytes());
      group_.clear();
      open_.clear();
      disk_->post([self = shared_from_this(), setsAside = setsAside_] {
        self->copy_ = nullptr;
        self->kept_.store.reset();
        self->kept_.makeStore = nullptr;
        if (setsAside) self->kept_.setAside();
        self->kept_.held.reset();
      });
    } else {
      proceed();
    }
  }
  for (const auto& w : refused)
    for (const Done& done : w->done) done(over(), 0);
}

void Edits::proceed() {
  expects(state_ == State::kBusy, "what goes on was begun");
  if (!differs_.empty()) {
    pool_->post([self = shared_from_this(), why = differs_] { self->leave(why, true); });
  } else if (order_->isBehind()) {
    if (!waiting_.empty()) order_->lose();
    pool_->post([self = shared_from_this()] { self->follow(); });
  } else if (order_->isHeldBack() || waiting_.empty()) {
    state_ = State::kRests;
    if (waiting_.empty()) order_->rest();
  } else if (!group_.empty()) {
    pool_->post([self = shared_from_this()] { self->make(); });
  } else {
    disk_->post([self = shared_from_this()] { self->lookUp(); });
  }
}

}  // namespace ridgecast::editing
