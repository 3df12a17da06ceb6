#include "server/editing/edit_order.h"

#include <algorithm>
#include <random>
#include <utility>

#include "common/edits/packed.h"
#include "common/outcome/contract.h"
#include "common/text/text.h"

namespace ridgecast::editing {

using edit_store::Applied;

namespace {

std::uint64_t anyTag() {
  std::random_device device;
  return std::uint64_t{device()} << 32 | device();
}

static_assert(EditOrder::kPageBytes > 2 * (edits::kMaxPackedBytes + 1024), "a page that begins with this server's last edit goes on");

constexpr char kAwayNow[] = "the engine cannot be reached";

}  // namespace

EditOrder::EditOrder(Shared shared, std::uint64_t last, std::optional<std::uint64_t> identity)
    : shared_(std::move(shared)), firstTag_(shared_.bus->server() != 0 ? anyTag() : 0), own_(last), identity_(identity) {
  expects(!isShared() || shared_.timer, "a server that is not alone has a timer");
}

void EditOrder::begin(std::function<void()> wake, ReadOwn readOwn) {
  if (!isShared()) return;
  wake_ = std::move(wake);
  readOwn_ = std::move(readOwn);
  hearing_ = shared_.bus->hear(channel(), [weak = weak_from_this()](const std::string& message) {
    if (const auto self = weak.lock()) self->heard(message);
  });
  watching_ = shared_.bus->watch(shared_.log, [weak = weak_from_this()](std::uint64_t last) {
    if (const auto self = weak.lock()) self->changed(last);
  });
}

void EditOrder::end() {
  bus::Subscription watching, hearing;  // released without the lock
  const std::lock_guard lock(mutex_);
  hasEnded_ = true;
  watching.swap(watching_);
  hearing.swap(hearing_);
}

bool EditOrder::isBehind() const {
  if (!isShared() || isAway()) return false;  // changed() is called when it is back
  const std::lock_guard lock(mutex_);
  return !hasEnded_ && last_ && (mustLook_ || *last_ != own_) && shared_.timer->now() >= pausedUntil_;
}

bool EditOrder::isHeldBack() const {
  if (!isShared()) return false;
  const bool isAwayNow = isAway();
  const std::lock_guard lock(mutex_);
  return !isAwayNow && (!last_ || mustLook_ || *last_ != own_ || shared_.timer->now() < heldUntil_);
}

bool EditOrder::isCurrent() const {
  if (!isShared() || isAway()) return true;
  const std::lock_guard lock(mutex_);
  return isCurrent_;
}

std::uint64_t EditOrder::own() const {
  const std::lock_guard lock(mutex_);
  return own_;
}

std::uint64_t EditOrder::behind() const {
  const std::lock_guard lock(mutex_);
  return last_ && *last_ > own_ ? *last_ - own_ : 0;
}

void EditOrder::applied(const Applied& last) {
  if (!isShared()) return;
  const std::lock_guard lock(mutex_);
  own_ = last.number;
  identity_ = edit_log::identityOf(last);
  isCurrent_ = isCurrent_ || (aim_ && own_ >= *aim_);
}

void EditOrder::wakeAt(Timer::Time when) const {
  shared_.timer->at(when, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->wake_();
  });
}

void EditOrder::pause(std::chrono::milliseconds time) {
  Timer::Time until;
  {
    const std::lock_guard lock(mutex_);
    pausedUntil_ = until = shared_.timer->now() + time;
    mustLook_ = true;
  }
  wakeAt(until);
}

// The first number of a log whose end was told already says that the engine was away, and what it has now must be compared.
void EditOrder::changed(std::uint64_t last) {
  {
    const std::lock_guard lock(mutex_);
    if (hasEnded_) return;
    if (!last_ || last <= told_) mustLook_ = true;
    told_ = last;
    last_ = last;
    pausedUntil_ = {};
  }
  wake_();
}

// ---- appending ----

void EditOrder::append(std::span<const Applied> edits, std::function<void(Decided)> done) {
  if (!isShared()) return done({});
  const bool isAwayNow = isAway();
  std::unique_lock lock(mutex_);
  expects(!edits.empty() && !open_, "edits are appended one batch after the other");
  if (isAwayNow || hasEnded_ || !last_ || mustLook_ || *last_ != own_) {
    lock.unlock();
    return done(isAwayNow ? Decided{Decided::Kind::kAway, 0, kAwayNow} : Decided{Decided::Kind::kLost});
  }
  expects(edits.front().number == own_ + 1, "edits are appended after those that this server has");
  open_ = Open{{shared_.bus->server(), firstTag_ + batches_++}, own_, {}, {}, 0, false, std::move(done)};
  for (const Applied& e : edits) {
    open_->entries.push_back(edit_log::pack(open_->batch, e));
    open_->identities.push_back(edit_log::identityOf(e));
  }
  lock.unlock();
  send();
}

void EditOrder::send() {
  std::uint64_t after = 0;
  std::vector<std::string> entries;
  {
    const std::lock_guard lock(mutex_);
    after = open_->after + open_->there;
    entries.assign(open_->entries.begin() + static_cast<std::ptrdiff_t>(open_->there), open_->entries.end());
  }
  shared_.bus->append(shared_.log, after, std::move(entries), bus::Bus::Origin::kNew, [weak = weak_from_this()](bus::Appended answer) {
    if (const auto self = weak.lock()) self->answered(std::move(answer));
  });
}

void EditOrder::answered(bus::Appended answer) {
  using Kind = bus::Appended::Kind;
  bool isUnsure = false;
  {
    const std::lock_guard lock(mutex_);
    if (answer.kind == Kind::kUnknown) open_->isUnsure = true;
    isUnsure = open_->isUnsure;
    if (answer.kind == Kind::kBehind) last_ = answer.last;
    if (answer.kind == Kind::kDone) last_ = std::max(last_.value_or(0), answer.last);
    if (answer.kind == Kind::kAway || answer.kind == Kind::kUnknown) mustLook_ = true;
  }
  switch (answer.kind) {
    case Kind::kDone:
      return decide({});
    case Kind::kBehind:
      return isUnsure ? resolveAt(answer.last) : decide({Decided::Kind::kLost});
    case Kind::kAway:
      return isUnsure ? retry() : decide({Decided::Kind::kAway, 0, std::move(answer.why)});
    case Kind::kFull:
      return isUnsure ? resolve(std::move(answer.why)) : decide({Decided::Kind::kFull, 0, std::move(answer.why)});
    case Kind::kUnknown:
      return retry();
  }
}

void EditOrder::retry() {
  shared_.timer->at(shared_.timer->now() + kRetry, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->resolve({});
  });
}

// The log ends with `last`. If that is before the batch, it has lost its end, and other servers may yet bring the batch back.
void EditOrder::resolveAt(std::uint64_t last) {
  bool isBefore = false;
  {
    const std::lock_guard lock(mutex_);
    isBefore = last < open_->after;
    open_->there = isBefore ? 0 : std::min<std::uint64_t>(open_->there, last - open_->after);
  }
  if (!isBefore) return resolve({});
  bringBack(last, [weak = weak_from_this()](const Next& next) {
    const auto self = weak.lock();
    if (!self) return;
    const bool goesOn = next.kind == Next::Kind::kNothing || next.kind == Next::Kind::kAway;
    goesOn ? self->retry() : self->decide({Decided::Kind::kLost});  // next() says why
  });
}

void EditOrder::resolve(std::optional<std::string> full) {
  std::uint64_t after = 0;
  bool hasEnded = false;
  {
    const std::lock_guard lock(mutex_);
    after = open_->after + open_->there;
    hasEnded = hasEnded_;
  }
  if (hasEnded) return decide({Decided::Kind::kUnknown});
  shared_.bus->read(shared_.log, after, kPageBytes, [weak = weak_from_this(), full = std::move(full)](auto entries) {
    if (const auto self = weak.lock()) self->resolved(std::move(entries), full);
  });
}

// Entries that another server has brought back have lost their tag.
void EditOrder::resolved(Outcome<std::vector<bus::Entry>> entries, const std::optional<std::string>& full) {
  if (!entries) return retry();
  bool isOthers = false, isWhole = false;
  std::size_t there = 0;
  {
    const std::lock_guard lock(mutex_);
    for (const bus::Entry& e : *entries) {
      if (open_->there == open_->entries.size() || isOthers) break;
      const auto entry = edit_log::unpackEntry(e.bytes);
      const edit_log::Batch unknown;
      if (entry && edit_log::identityOf(entry->edit) == open_->identities[open_->there] &&
          (entry->batch == open_->batch || entry->batch == unknown))
        ++open_->there;
      else
        isOthers = true;
    }
    there = open_->there;
    isWhole = there == open_->entries.size();
    last_ = std::max(last_.value_or(0), open_->after + there);
  }
  if (isWhole) return decide({});
  if (isOthers) return decide({Decided::Kind::kLost, there});
  if (!entries->empty()) return resolve(full);  // there may be more
  if (full) return there == 0 ? decide({Decided::Kind::kFull, 0, *full}) : retry();
  send();
}

void EditOrder::decide(Decided decided) {
  std::function<void(Decided)> done;
  {
    const std::lock_guard lock(mutex_);
    done = std::move(open_->done);
    open_.reset();
    if (decided.kind == Decided::Kind::kDone) losses_ = 0;
  }
  done(std::move(decided));
}

// ---- turns ----

void EditOrder::rest() {
  const std::lock_guard lock(mutex_);
  losses_ = 0;
}

void EditOrder::lose() {
  if (!isShared()) return;
  const std::lock_guard lock(mutex_);
  if (!last_ || *last_ > own_ + kNear) return;
  const Timer::Time now = shared_.timer->now();
  if (++losses_ == kMaxLosses) claimsUntil_ = now + kLongestClaim;
  if (losses_ < kMaxLosses || std::exchange(isClaiming_, true)) return;
  shared_.timer->at(now, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->claim();
  });
}

void EditOrder::claim() {
  int losses = 0;
  const Timer::Time now = shared_.timer->now();
  {
    const std::lock_guard lock(mutex_);
    if (now > claimsUntil_) losses_ = 0;
    if (losses_ < kMaxLosses || hasEnded_) {
      isClaiming_ = false;
      return;
    }
    losses = losses_;
  }
  shared_.bus->tell(channel(), std::to_string(losses) + ' ' + std::to_string(shared_.bus->server()));
  shared_.timer->at(now + kClaim, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->claim();
  });
}

void EditOrder::heard(const std::string& message) {
  std::string_view rest = message;
  const auto losses = text::number<int>(text::takePart(rest, ' '));
  const auto server = text::number<std::uint32_t>(rest);
  if (!losses || !server) return;
  Timer::Time until;
  {
    const std::lock_guard lock(mutex_);
    const bool isBetter = *losses > losses_ || (*losses == losses_ && *server < shared_.bus->server());
    if (!isBetter) return;
    holder_ = *server;
    heldUntil_ = until = shared_.timer->now() + kHold;
  }
  wakeAt(until);
}

// ---- following ----

EditOrder::Next EditOrder::differs(std::uint64_t number, std::uint64_t theirs, std::uint64_t ours) const {
  return {Next::Kind::kDiffers,
          {},
          "edit " + std::to_string(number) + " of this server has the hash " + text::hexadecimal(ours) + ", that of the shared log " +
              text::hexadecimal(theirs)};
}

void EditOrder::look(std::function<void(Next)> done) {
  bool isKnown = false;
  {
    const std::lock_guard lock(mutex_);
    mustLook_ = true;
    isKnown = last_.has_value();
  }
  if (!isKnown || isAway()) return done({Next::Kind::kAway});
  next(std::move(done));
}

void EditOrder::next(std::function<void(Next)> done) {
  std::uint64_t told = 0, after = 0;
  {
    const std::lock_guard lock(mutex_);
    expects(!open_ && last_, "edits are followed while none is appended");
    told = *last_;
    mustLook_ = false;
    after = identity_ && own_ > 0 ? own_ - 1 : own_;
  }
  if (told < own()) return bringBack(told, std::move(done));
  shared_.bus->read(shared_.log, after, kPageBytes, [weak = weak_from_this(), after, told, done = std::move(done)](auto entries) {
    if (const auto self = weak.lock()) done(self->readNext(std::move(entries), after, told));
  });
}

EditOrder::Next EditOrder::readNext(Outcome<std::vector<bus::Entry>> entries, std::uint64_t after, std::uint64_t told) {
  Next next;
  const std::uint64_t own = this->own();
  if (!entries || (after < own && entries->empty())) {  // away, or it has just lost its end
    pause(kRetry);
    next.kind = Next::Kind::kAway;
    return next;
  }
  const std::lock_guard lock(mutex_);
  for (const bus::Entry& e : *entries) {
    auto entry = edit_log::unpackEntry(e.bytes);
    std::string wrong = entry ? "" : e.bytes.empty() ? "the engine has lost it" : entry.error().message;
    if (entry && (e.number != ++after || entry->edit.number != after)) wrong = "it has the number " + std::to_string(entry->edit.number);
    if (!wrong.empty()) {
      if (!next.entries.empty()) break;  // those before it first
      next.why = "entry " + std::to_string(e.number) + " of the shared log cannot be read: " + wrong;
      next.kind = Next::Kind::kUnreadable;
      return next;
    }
    if (after == own) {
      if (const std::uint64_t theirs = edit_log::identityOf(entry->edit); theirs != *identity_) return differs(own, theirs, *identity_);
      continue;
    }
    if (entry->batch.server == holder_) heldUntil_ = {};
    next.entries.push_back(std::move(entry->edit));
  }
  if (next.entries.empty()) {
    if (last_ == told) last_ = own;
    isCurrent_ = isCurrent_ || last_ == own;
    return next;
  }
  next.kind = Next::Kind::kEntries;
  if (!aim_) aim_ = told;
  last_ = std::max(last_.value_or(0), next.entries.back().number);
  return next;
}

void EditOrder::bringBack(std::uint64_t after, std::function<void(Next)> done) {
  readOwn_(after, [weak = weak_from_this(), after, done = std::move(done)](const Outcome<std::vector<Applied>>& edits) {
    if (!edits) return done({Next::Kind::kUnreadable, {}, edits.error().message});
    if (const auto self = weak.lock()) self->bringBack(after, *edits, done);
  });
}

void EditOrder::bringBack(std::uint64_t after, const std::vector<Applied>& edits, const std::function<void(Next)>& done) {
  expects(!edits.empty() && (edits.front().number == after || edits.front().number == after + 1), "what is brought back follows the log");
  const bool compares = edits.front().number == after;
  const std::uint64_t ours = edit_log::identityOf(edits.front());
  std::vector<std::string> entries;
  for (std::size_t k = compares ? 1 : 0; k < edits.size(); ++k) entries.push_back(edit_log::pack({}, edits[k]));
  const auto append = [weak = weak_from_this(), after, entries = std::move(entries), done] {
    const auto self = weak.lock();
    if (!self) return;
    if (entries.empty()) return self->pause(kRetry), done({});
    self->shared_.bus->append(self->shared_.log, after, entries, bus::Bus::Origin::kKept,
                              [weak, after, count = entries.size(), done](const bus::Appended& answer) {
                                if (const auto order = weak.lock()) order->broughtBack(after, count, answer, done);
                              });
  };
  if (!compares) return append();
  shared_.bus->read(shared_.log, after - 1, 1, [weak = weak_from_this(), after, ours, append, done](const auto& read) {
    const auto self = weak.lock();
    if (!self) return;
    if (!read || read->empty()) return self->pause(kRetry), done({Next::Kind::kAway});
    const auto entry = edit_log::unpackEntry(read->front().bytes);
    if (!entry)
      return done(
          {Next::Kind::kUnreadable, {}, "entry " + std::to_string(after) + " of the shared log cannot be read: " + entry.error().message});
    if (const std::uint64_t theirs = edit_log::identityOf(entry->edit); theirs != ours) return done(self->differs(after, theirs, ours));
    append();
  });
}

void EditOrder::broughtBack(std::uint64_t after, std::size_t count, const bus::Appended& answer, const std::function<void(Next)>& done) {
  using Kind = bus::Appended::Kind;
  if (answer.kind == Kind::kDone || answer.kind == Kind::kBehind) {
    const std::lock_guard lock(mutex_);
    last_ = answer.kind == Kind::kDone ? after + count : answer.last;
    mustLook_ = true;
  } else {
    pause(answer.kind == Kind::kFull ? 10 * kRetry : kRetry);
  }
  done({});
}

}  // namespace ridgecast::editing
