// Edits of other servers (edits.h): applied in the order of the log that all share, between this server's own groups.

#include <algorithm>
#include <iterator>
#include <new>
#include <string>
#include <utility>

#include "common/edits/edited_terrain.h"
#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "server/editing/edits.h"
#include "server/logging/logging.h"

namespace ridgecast::editing {

namespace {

std::string nameOf(const Applied& followed) { return "edit " + std::to_string(followed.number) + " of the shared log "; }

}  // namespace

void Edits::begin() {
  if (!order_->isShared() || !stopped_.empty()) return;
  check_->begin([weak = weak_from_this()](const std::string& sentence) {
    const auto self = weak.lock();
    if (!self) return;
    {
      const std::lock_guard lock(self->mutex_);
      self->differs_ = sentence;
    }
    self->wake();
  });
  order_->begin(
      [weak = weak_from_this()] {
        if (const auto self = weak.lock()) self->wake();
      },
      [weak = weak_from_this()](std::uint64_t after, auto done) {
        if (const auto self = weak.lock()) self->disk_->post([self, after, done = std::move(done)] { done(self->readOwn(after)); });
      });
}

bool Edits::isCurrent() const {
  if (order_->isCurrent()) return true;
  const std::lock_guard lock(mutex_);
  return !stopped_.empty() || state_ == State::kOver;
}

void Edits::wake() {
  const std::lock_guard lock(mutex_);
  if (state_ != State::kRests) return;
  state_ = State::kBusy;
  proceed();
}

void Edits::follow() {
  if (isOver()) return goOn();
  group_.clear();  // their keys are looked up again on the new ground
  order_->next([self = shared_from_this()](EditOrder::Next next) {
    self->pool_->post([self, next = std::move(next)]() mutable { self->followed(std::move(next)); });
  });
}

void Edits::followed(EditOrder::Next next) {
  if (isOver()) return goOn();
  switch (next.kind) {
    case EditOrder::Next::Kind::kEntries:
      followed_.assign(std::make_move_iterator(next.entries.begin()), std::make_move_iterator(next.entries.end()));
      return apply();
    case EditOrder::Next::Kind::kDiffers:
      return leave(next.why, true);
    case EditOrder::Next::Kind::kUnreadable:
      return stop(next.why);
    case EditOrder::Next::Kind::kNothing:
    case EditOrder::Next::Kind::kAway:
      return goOn();
  }
}

// Some of them at a time; an undo may take long, and those before it do not wait for it.
void Edits::apply() {
  if (isOver()) {
    batch_.making.reset();
    return goOn();
  }
  if (batch_.made.empty() && !batch_.making) batch_.before = history_.layer();
  const auto begun = std::chrono::steady_clock::now();
  bool isGroup = false;
  try {
    while (!followed_.empty() && !isGroup && std::chrono::steady_clock::now() - begun < turn_) {
      if (!batch_.making) {
        auto operation = edits::unpack(followed_.front().operation);
        isGroup = !batch_.made.empty() && (!operation || edits::undoneBy(followed_.front().operation) > 0);
        if (isGroup) break;
        if (!operation) return stop(nameOf(followed_.front()) + "cannot be read: " + operation.error().message);
        batch_.making =
            std::make_unique<Making>(history_.make(std::move(*operation)), history_.layer(), history_.last(), history_.looked());
      }
      if (auto done = applyNext(); !done) {
        batch_.making.reset();
        return leave(done.error().message, true);
      }
    }
    if (!followed_.empty() && !isGroup) {
      pool_->post([self = shared_from_this()] { self->apply(); });
      return;
    }
    batch_.next = {std::make_shared<edits::EditedTerrain>(history_.terrain(), history_.layer()), history_.last()};
  } catch (const std::bad_alloc&) {
    if (batch_.making && history_.last() > batch_.making->last) history_.takeBack(batch_.making->before);
    makeAgain();
    order_->pause(std::chrono::milliseconds(1000));
    logging::error("The server ran out of memory at other servers' edits; it tries again.");
    return goOn();
  }
  disk_->post([self = shared_from_this()] { self->keep(); });
}

Outcome<void> Edits::applyNext() {
  batch_.made.reserve(batch_.made.size() + 1);
  batch_.changed.reserve(batch_.made.size() + 1);
  constexpr std::uint64_t kPosts = 1u << 14;
  if (!batch_.making->making.step(kPosts)) return {};
  const Applied& next = followed_.front();
  const auto& changed = batch_.making->making.result();
  if (!changed) return Error{nameOf(next) + "cannot be made on this server's ground: " + changed.error().message};
  expects(next.number == history_.last(), "edits are followed one by one");
  const bool isSame = history_.packed(next.number) == next.operation &&
                      (next.ground == edits::groundOf(*changed) || next.ground == edit_store::kEverywhere);
  if (!isSame) return Error{nameOf(next) + "changes another ground here than where it was made"};
  if (next.number % GroundCheck::kEvery == 0) batch_.checked.emplace_back(batch_.made.size(), history_.layer());
  batch_.changed.push_back(*changed);
  batch_.made.push_back(next);
  count(next);
  batch_.making.reset();
  followed_.pop_front();
  return {};
}

// By the disk's thread.
Outcome<std::vector<Applied>> Edits::readOwn(std::uint64_t after) {
  if (!kept_.store) return Error{"the session has ended"};
  const std::uint64_t compacted = kept_.store->compacted();
  if (after < compacted)
    return Error{"the log ends with edit " + std::to_string(after) + ", and this server's edits up to " + std::to_string(compacted) +
                 " were compacted, so that it cannot be given them"};
  std::vector<Applied> edits;
  for (const auto& [number, most] : {std::pair(after, std::size_t{0}), std::pair(after + 1, EditOrder::kPageBytes)}) {
    if (number == compacted) continue;
    auto some = kept_.store->read(number - 1, most);
    if (!some) return told(some.error());
    if (some->empty()) return Error{"edit " + std::to_string(number) + " of this server is missing"};
    std::ranges::move(*some, std::back_inserter(edits));
  }
  return edits;
}

// ---- own groups ----

void Edits::notAppended(const EditOrder::Decided& decided) {
  using Kind = EditOrder::Decided::Kind;
  if (decided.kind == Kind::kLost) {
    // Those that are in the log are made; they have their answers when they are applied as all in it.
    const std::uint64_t before = batch_.made.front().number - 1;
    std::deque<Applied> there(batch_.made.begin(), batch_.made.begin() + static_cast<std::ptrdiff_t>(decided.there));
    std::size_t answered = 0;
    for (std::size_t k = 0; k < batch_.done; ++k)
      if (const auto& answer = *group_[k]->answer; answer && *answer > before && *answer <= before + there.size()) answered = k + 1;
    auto group = group_;
    makeAgain();
    if (there.empty()) return goOn();
    group.resize(answered);
    group_ = std::move(group);
    batch_.done = answered;
    followed_ = std::move(there);
    return apply();
  }
  if (decided.kind == Kind::kAway) {
    refuseMade(away());
  } else if (decided.kind == Kind::kFull) {
    logging::error({.reason = "full"}, kept_.folder + "Edits were not appended to the shared log: " + decided.why);
    refuseMade(
        refusal(Answer::Why::kFull,
                "There is no room for edits of this session, so the edit was not made; send it again when its operator has made some."));
  } else {
    refuseMade(refusal(Answer::Why::kOver,
                       "The session has ended before it was known whether the edit is made; send it again there, with its key."));
  }
  publish();
}

// Whether an edit can be made is decided where the log ends.
void Edits::confirm() {
  const auto isRefused = [](const auto& w) { return !*w->answer && w->answer->why == Answer::Why::kWrong; };
  if (!order_->isShared() || std::none_of(group_.begin(), group_.begin() + static_cast<std::ptrdiff_t>(batch_.done), isRefused))
    return publish();
  order_->look([self = shared_from_this()](EditOrder::Next next) {
    self->pool_->post([self, next = std::move(next)]() mutable { self->confirmed(std::move(next)); });
  });
}

void Edits::confirmed(EditOrder::Next next) {
  if (next.kind == EditOrder::Next::Kind::kNothing) return publish();
  if (next.kind == EditOrder::Next::Kind::kAway) {
    for (std::size_t k = 0; k < batch_.done; ++k)
      if (auto& answer = group_[k]->answer; !*answer && answer->why == Answer::Why::kWrong) answer = away();
    return publish();
  }
  makeAgain();
  followed(std::move(next));
}

// Nothing of the group is made now, and all of it waits.
void Edits::makeAgain() {
  batch_.making.reset();
  if (!batch_.made.empty()) takeBack();
  group_.clear();
  followed_.clear();
  batch_ = {};
}

// ---- the end of it ----

void Edits::stop(const std::string& why) {
  logging::error(kept_.folder + "The session takes no more edits on this server: " + why + ".");
  order_->end();
  std::deque<std::shared_ptr<Waiting>> refused;
  {
    const std::lock_guard lock(mutex_);
    stopped_ = kCannotFollow;
    refused.swap(waiting_);
    for (const auto& w : refused) space_->waiting.give(w->asked.bytes());
    open_.clear();
  }
  for (const auto& w : refused)
    for (const Done& done : w->done) done(refusal(Answer::Why::kFull, stopped_), 0);
  goOn();
}

void Edits::leave(const std::string& why, bool setsAside) {
  logging::error(kept_.folder + "The session cannot go on on this server, whose clients must connect again: " + why + ".");
  order_->end();
  {
    const std::lock_guard lock(mutex_);
    if (state_ != State::kOver) setsAside_ = setsAside;
    state_ = State::kOver;
  }
  goOn();
  left_();
}

}  // namespace ridgecast::editing
