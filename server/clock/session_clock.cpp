#include "server/clock/session_clock.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"

namespace ridgecast::clock {

namespace {

constexpr const char* kCalls = "/calls";

}  // namespace

SessionClock::SessionClock(const Timer& timer, wire::ClockMode mode, std::shared_ptr<recording::Observer> observer)
    : timer_(timer), observer_(std::move(observer)), clock_(timer.now(), mode) {
  note();
}

void SessionClock::play(const wire::Clock& recording, std::function<void(std::uint64_t time)> goBack) {
  const std::lock_guard lock(mutex_);
  expects(!shared_, "a recording's clock is one server's");
  goBack_ = std::move(goBack);
  clock_.play(recording, timer_.now());
  changed();
}

SessionClock::~SessionClock() {
  if (!shared_ || isOver_) return;
  shared_->end();
  for (const SharedClock::Wish& wish : shared_->takeNews().wishes) carryOut(wish);
}

void SessionClock::join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, std::optional<wire::World> world) {
  Lock lock(mutex_);
  expects(!entries_.contains(camera), "a member joins the clock once");
  Entry& entry = entries_[camera];
  entry = {std::move(sender), hello.clock, hello.members || hello.clock};
  if (entry.follows && !shared_) clock_.follow(camera);
  if (world) entry.sender->send(std::move(*world));
  if (!entry.follows) return;
  send(entry, 0);
  if (!shared_) return;
  shared_->call({.kind = Call::Kind::kFollow, .member = camera}, sharedNow());
  settle(lock);
}

void SessionClock::leave(std::uint64_t camera) {
  Lock lock(mutex_);
  if (entries_.erase(camera) == 0) return;
  if (shared_) {
    shared_->call({.kind = Call::Kind::kLeave, .member = camera}, sharedNow());
    settle(lock);
  } else if (clock_.leave(camera, timer_.now())) {
    changed();
  }
}

void SessionClock::receive(std::uint64_t camera, const wire::AskClock& ask) {
  const Lock lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) send(it->second, ask.echo);
}

void SessionClock::receive(std::uint64_t camera, const wire::SetClock& set) {
  Lock lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  const Call call{.kind = Call::Kind::kSet, .member = camera, .set = set};
  if (shared_) {
    if (refuses(it->second)) return;
    shared_->call(call, sharedNow());
    return settle(lock);
  }
  Effect effect = apply(clock_, call, timer_.now());
  if (effect.isChanged) changed();
  if (effect.goesBack && goBack_) {
    goBack_(set.time);
    effect.notices.clear();
  }
  sendAll(effect.notices);
  if (effect.notices.empty() && !it->second.follows) send(it->second, 0);
}

Clock::Stepped SessionClock::step(std::uint64_t camera, const wire::ClockStep& step) {
  Lock lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return Clock::Stepped::kNotYours;
  const Call call{.kind = Call::Kind::kStep, .member = camera, .step = step};
  if (shared_) {
    if (refuses(it->second)) return Clock::Stepped::kNotYours;
    if (shared_->pendingSteps(camera) >= Clock::kMaxQueuedSteps) return Clock::Stepped::kTooMany;
    shared_->call(call, sharedNow());
    settle(lock);
    return Clock::Stepped::kQueues;
  }
  const Effect effect = apply(clock_, call, timer_.now());
  if (effect.isChanged) changed();
  if (effect.stepped == Clock::Stepped::kNotYours) sendAll(effect.notices);
  return effect.stepped;
}

void SessionClock::receive(std::uint64_t camera, const wire::StepDone& done) {
  Lock lock(mutex_);
  const Call call{.kind = Call::Kind::kDone, .member = camera, .number = done.step};
  if (shared_) {
    shared_->call(call, sharedNow());
    settle(lock);
  } else if (apply(clock_, call, timer_.now()).isChanged) {
    changed();
  }
}

void SessionClock::receive(std::uint64_t camera, const wire::PassOver& pass) {
  Lock lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  const Call call{.kind = Call::Kind::kPassOver, .member = camera, .number = pass.camera};
  if (shared_) {
    if (refuses(it->second)) return;
    shared_->call(call, sharedNow());
    return settle(lock);
  }
  const Effect effect = apply(clock_, call, timer_.now());
  if (effect.isChanged) changed();
  sendAll(effect.notices);
}

void SessionClock::tell(std::string sentence) {
  sentence.resize(std::min<std::size_t>(sentence.size(), wire::kMaxErrorBytes));
  const Lock lock(mutex_);
  for (auto& [id, entry] : entries_)
    if (entry.hears) send(entry, 0, sentence);
}

void SessionClock::refuse(std::uint64_t camera, std::string sentence) {
  const Lock lock(mutex_);
  sendAll({{camera, std::move(sentence), true}});
}

wire::Clock SessionClock::state() const {
  const Lock lock(mutex_);
  return now();
}

std::uint64_t SessionClock::time() const {
  const Lock lock(mutex_);
  return shared_ ? shared_->time(sharedNow()) : clock_.time(timer_.now());
}

bool SessionClock::endsStepHere(std::uint64_t camera, std::uint64_t step) const {
  const Lock lock(mutex_);
  const Clock::State& all = shown().all();
  if (all.step != step || !all.waitsFor.contains(camera)) return false;
  return (shared_ ? shared_->undone([&](std::uint64_t member) { return entries_.contains(member); }) : all.waitsFor) == std::set{camera};
}

bool SessionClock::beginsStep(std::uint64_t camera) const {
  const Lock lock(mutex_);
  const Clock::State& all = shown().all();
  return all.mode == wire::ClockMode::kStepped && all.owner == camera && all.waitsFor.empty();
}

std::set<std::uint64_t> SessionClock::listeners() const {
  const Lock lock(mutex_);
  std::set<std::uint64_t> all = shown().all().followers;
  if (shown().owner() != 0) all.insert(shown().owner());
  return all;
}

wire::Clock SessionClock::now() const { return shared_ ? shared_->state(sharedNow()) : clock_.state(timer_.now()); }

void SessionClock::watchStep() {
  if (shared_) return;  // its leader does
  const Timer::Time now = timer_.now();
  if (clock_.step() != watchedStep_) {
    watchedStep_ = clock_.step();
    stepBegan_ = now;
  }
  if (clock_.waitsFor().empty()) return;
  stepAlarm_.set(timer_, stepBegan_ + kStepTimeout, weak_from_this(), mutex_, &SessionClock::passOverLate);
}

void SessionClock::passOverLate() {
  if (timer_.now() >= stepBegan_ + kStepTimeout)
    for (const std::uint64_t late : std::set(clock_.waitsFor())) {
      const Effect effect = passOver(clock_, late, whyLate());
      if (effect.isChanged) changed();
      sendAll(effect.notices);
    }
  watchStep();
}

void SessionClock::note() const {
  if (!observer_) return;
  const wire::Clock clock = now();
  observer_->note(timer_.now(), recording::Clocked{clock.mode, clock.rate, clock.time, clock.owner, clock.step});
}

void SessionClock::changed() {
  note();
  watchStep();
  for (auto& [id, entry] : entries_) entry.isStale = entry.follows;
  notify();
}

void SessionClock::notify() {
  bool all = true;
  for (auto& [id, entry] : entries_) {
    if (!entry.isStale) continue;
    if (entry.waiting.expired())
      send(entry, 0);
    else
      all = false;
  }
  if (!all) notifyAlarm_.set(timer_, timer_.now() + kRetry, weak_from_this(), mutex_, &SessionClock::notify);
}

void SessionClock::sendAll(const std::vector<Notice>& notices) {
  for (const Notice& notice : notices)
    if (const auto it = entries_.find(notice.member); it != entries_.end()) send(it->second, 0, notice.sentence, notice.isRefusal);
}

void SessionClock::send(Entry& entry, std::uint64_t echo, std::string notice, bool isRefusal) {
  if (!entry.sender) return;  // a recording's member
  wire::Clock clock = now();
  clock.echo = echo;
  clock.notice = std::move(notice);
  clock.refuses = isRefusal;
  entry.isStale = false;
  const std::shared_ptr<const void> held = std::make_shared<char>();
  entry.waiting = held;
  entry.sender->send(std::move(clock), held);
}

// ---- shared with other servers ----

void SessionClock::share(std::shared_ptr<bus::Bus> bus, std::string key, std::function<void()> beforeStep) {
  {
    Lock lock(mutex_);
    expects(!bus_ && entries_.empty() && !goBack_, "a clock is shared before anybody has it");
    bus_ = std::move(bus);
    key_ = std::move(key);
    beforeStep_ = std::move(beforeStep);
    shared_.emplace(bus_->server(), clock_.all().mode, sharedNow());
  }
  told_ = bus_->hear(key_, [weak = weak_from_this()](const std::string& message) {
    const auto self = weak.lock();
    if (!self) return;
    auto told = toldOf(message);
    self->announceStep(told);
    self->use([&](SharedClock& shared, const SharedClock::Now& now) { shared.heardTold(std::move(told), now); });
  });
  calls_ = bus_->hear(key_ + kCalls, [weak = weak_from_this()](const std::string& message) {
    if (const auto self = weak.lock())
      self->use([&](SharedClock& shared, const SharedClock::Now& now) { shared.heardCalls(message, now); });
  });
  use([](SharedClock&, const SharedClock::Now&) {});
  setTick();
}

void SessionClock::end(bool forgets) {
  Lock lock(mutex_);
  if (!shared_ || isOver_.exchange(true)) return;
  const bool isLast = forgets && shared_->leadsAlone();
  const std::uint64_t epoch = shared_->epoch();
  shared_->end();
  const SharedClock::News last = shared_->takeNews();
  lock.unlock();
  if (isLast) return bus_->drop(key_, epoch);
  for (const SharedClock::Wish& wish : last.wishes) carryOut(wish);
}

SharedClock::Now SessionClock::sharedNow() const {
  return {timer_.now(), Clock::Instant(std::chrono::microseconds(bus_->now())), bus_->isAway()};
}

bool SessionClock::isCurrent() const {
  const Lock lock(mutex_);
  return !shared_ || shared_->version() > 0 || bus_->isAway();
}

bool SessionClock::refuses(Entry& entry) {
  if (!bus_->isAway()) return false;
  send(entry, 0,
       "The engine that the servers of this world share cannot be reached: until it can, the clock goes on as it is and takes neither "
       "settings nor steps.",
       true);
  return true;
}

template <class Use>
void SessionClock::use(const Use& use) {
  Lock lock(mutex_);
  use(*shared_, sharedNow());
  settle(lock);
}

template <class Said>
void SessionClock::announceStep(const Said& said) const {
  if (!beforeStep_) return;
  Lock lock(mutex_);
  if (!shared_->turnsStep(said)) return;
  lock.unlock();
  beforeStep_();
}

void SessionClock::settle(Lock& lock) {
  SharedClock::News news = shared_->takeNews();
  if (isOver_) return;
  if (!news.problem.empty() && std::exchange(problem_, news.problem) != news.problem)
    logging::warning({.event = "clock"}, key_ + ": " + news.problem);
  if (news.isChanged) changed();
  sendAll(news.notices);
  for (const std::uint64_t camera : news.answered)
    if (const auto it = entries_.find(camera);
        it != entries_.end() && !it->second.follows && std::ranges::find(news.notices, camera, &Notice::member) == news.notices.end())
      send(it->second, 0);
  for (SharedClock::Wish& wish : news.wishes) wishes_.push_back(std::move(wish));
  if (std::exchange(isCarryingOut_, true)) return;
  while (!wishes_.empty()) {  // one thread at a time, so that they keep their order
    const SharedClock::Wish wish = std::move(wishes_.front());
    wishes_.pop_front();
    lock.unlock();
    carryOut(wish);
    lock.lock();
  }
  isCarryingOut_ = false;
}

void SessionClock::carryOut(const SharedClock::Wish& wish) {
  const auto answered = [weak = weak_from_this()](Outcome<bus::Bus::Held> held) {
    const auto self = weak.lock();
    if (!self) return;
    self->announceStep(held);
    self->use([&](SharedClock& shared, const SharedClock::Now& now) { shared.answered(std::move(held), now); });
  };
  switch (wish.kind) {
    case SharedClock::Wish::Kind::kHold:
      return bus_->hold(key_, wish.value, wish.epoch, SharedClock::kLife, answered);
    case SharedClock::Wish::Kind::kTake:
      return bus_->take(key_, wish.epoch, answered);
    case SharedClock::Wish::Kind::kTell:
      return bus_->tell(key_, wish.value);
    case SharedClock::Wish::Kind::kCall:
      return bus_->tell(key_ + kCalls, wish.value);
  }
}

void SessionClock::setTick() {
  timer_.at(timer_.now() + SharedClock::kTick, [weak = weak_from_this()] {
    const auto self = weak.lock();
    if (!self) return;
    self->use([](SharedClock& shared, const SharedClock::Now& now) { shared.tick(now); });
    if (!self->isOver_) self->setTick();
  });
}

}  // namespace ridgecast::clock
