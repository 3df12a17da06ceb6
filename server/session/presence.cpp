#include "server/session/presence.h"

#include <algorithm>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::session {

namespace {

std::shared_ptr<const void> ticket() { return std::make_shared<char>(); }

std::size_t bytesOf(const wire::Moved& moved) { return 80 + moved.pose.state.size(); }

// Approximately.
std::size_t bytesOf(const wire::Members& news) {
  std::size_t bytes = 8 + 4 * news.left.size();
  for (const wire::Member& member : news.joined) bytes += 8 + member.name.size() + (member.moved ? bytesOf(*member.moved) : 0);
  for (const wire::Moved& moved : news.moved) bytes += bytesOf(moved);
  return bytes;
}

}  // namespace

Presence::Presence(const Timer& timer, wire::ClockMode clock, std::shared_ptr<recording::Observer> observer)
    : timer_(timer), observer_(std::move(observer)), clock_(timer.now(), clock) {
  noteClock();
}

void Presence::play(const wire::Clock& recording, std::function<void(std::uint64_t time)> goBack) {
  const std::lock_guard lock(mutex_);
  goBack_ = std::move(goBack);
  clock_.play(recording, timer_.now());
  clockChanged();
}

void Presence::join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender,
                    const std::optional<wire::PoseMessage>& pose, std::optional<wire::World> world) {
  const std::lock_guard lock(mutex_);
  expects(!entries_.contains(camera), "a member joins once");
  expects(camera != 0 && (sender || !world), "a member has a number, and a way to it if it is told of the world");
  Entry& entry = entries_[camera];
  entry.member = {camera, hello.role, hello.clientName, {}};
  entry.sender = std::move(sender);
  entry.wantsMembers = hello.members;
  entry.wantsClock = hello.clock;
  entry.joinedAt = ++version_;
  if (pose) {
    entry.member.moved = wire::Moved{camera, *pose, clock_.time(timer_.now())};
    entry.movedAt = version_;
  }
  if (world) entry.sender->send(std::move(*world));
  if (entry.wantsClock) {
    clock_.follow(camera);
    sendClock(entry, 0);
  }
  membersChanged();
}

void Presence::receive(std::uint64_t camera, const wire::PoseMessage& pose) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  it->second.member.moved = wire::Moved{camera, pose, clock_.time(timer_.now())};
  it->second.movedAt = ++version_;
  membersChanged();
}

void Presence::leave(std::uint64_t camera) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  const std::uint64_t joinedAt = it->second.joinedAt;
  entries_.erase(it);
  for (auto& [id, entry] : entries_)
    if (entry.wantsMembers && entry.notified >= joinedAt) entry.left.push_back(camera);
  ++version_;
  membersChanged();
  if (clock_.leave(camera, timer_.now())) clockChanged();
}

// ---- members ----

void Presence::setBudget(std::uint64_t camera, std::uint64_t bytesPerSecond) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) it->second.budget.setRate(bytesPerSecond / 4);
}

std::size_t Presence::takeBytes(std::uint64_t camera) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  return it == entries_.end() ? 0 : std::exchange(it->second.bytes, 0);
}

void Presence::membersChanged() {
  if (std::none_of(entries_.begin(), entries_.end(), [](const auto& e) { return e.second.wantsMembers; })) return;
  membersAlarm_.set(timer_, std::max(timer_.now(), lastNotified_ + kMinPause), weak_from_this(), mutex_, &Presence::notifyMembers);
}

void Presence::notifyMembers() {
  lastNotified_ = timer_.now();
  bool all = true;
  for (auto& [id, entry] : entries_)
    if (entry.wantsMembers && !notify(entry)) all = false;
  if (!all) membersChanged();
}

bool Presence::notify(Entry& entry) {
  if (entry.notified == version_) return true;
  if (!entry.waiting.expired() || entry.budget.free() > timer_.now()) return false;
  expects(entry.notified < version_, "versions go up");
  wire::Members news;
  for (const auto& [id, other] : entries_) {
    if (&other == &entry) continue;
    if (other.joinedAt > entry.notified)
      news.joined.push_back(other.member);
    else if (other.movedAt > entry.notified)
      news.moved.push_back(*other.member.moved);
  }
  news.left = std::exchange(entry.left, {});
  const bool first = entry.notified == 0;  // the first is sent even if nobody else is there
  entry.notified = version_;
  if (!first && news.joined.empty() && news.moved.empty() && news.left.empty()) return true;
  const std::size_t bytes = bytesOf(news);
  entry.budget.spend(timer_.now(), bytes);
  entry.bytes += bytes;
  const auto held = ticket();
  entry.waiting = held;
  entry.sender->send(std::move(news), held);
  return true;
}

// ---- clock ----

void Presence::receive(std::uint64_t camera, const wire::AskClock& ask) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) sendClock(it->second, ask.echo);
}

void Presence::receive(std::uint64_t camera, const wire::SetClock& set) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  const Timer::Time now = timer_.now();
  const bool changed = clock_.set(camera, set, now);
  if (changed) clockChanged();
  const bool goesBack = changed && set.own && set.time != 0 && set.time < clock_.time(now);
  if (goesBack && goBack_) goBack_(set.time);
  std::string notice;
  if (!changed) notice = whyNotYours();
  if (goesBack && !goBack_) notice = "Time goes back only in recordings.";
  if (changed && set.own && clock_.isTooFarAhead(set.time, now))
    notice = "A jump takes the clock at most an hour ahead, and to at most 142 years.";
  if (!notice.empty() || !it->second.wantsClock) sendClock(it->second, 0, std::move(notice));
}

Clock::Stepped Presence::step(std::uint64_t camera, const wire::ClockStep& step) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return Clock::Stepped::kNotYours;
  const Clock::Stepped stepped = clock_.step(camera, step);
  if (stepped == Clock::Stepped::kBegins) clockChanged();
  if (stepped == Clock::Stepped::kNotYours) sendClock(it->second, 0, whyNotYours());
  return stepped;
}

void Presence::receive(std::uint64_t camera, const wire::StepDone& done) {
  const std::lock_guard lock(mutex_);
  if (clock_.done(camera, done.step)) clockChanged();
}

void Presence::receive(std::uint64_t camera, const wire::PassOver& pass) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  if (clock_.owner() != camera) return sendClock(it->second, 0, whyNotYours());
  if (passOver(pass.camera, "by the clock's owner")) return;
  sendClock(it->second, 0,
            "No step waits for member " + std::to_string(pass.camera) + ": it does not follow the clock or was passed over before.");
}

void Presence::tell(std::string sentence) {
  sentence.resize(std::min<std::size_t>(sentence.size(), wire::kMaxErrorBytes));
  const std::lock_guard lock(mutex_);
  for (auto& [id, entry] : entries_)
    if (entry.wantsMembers || entry.wantsClock) sendClock(entry, 0, sentence);
}

void Presence::tell(std::uint64_t camera, std::string sentence) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) sendClock(it->second, 0, std::move(sentence));
}

std::string Presence::whyNotYours() const {
  if (clock_.owner() == 0) return "Nobody owns the clock: take it with set clock first.";
  return "The clock belongs to member " + std::to_string(clock_.owner()) + ": only its owner sets and steps it.";
}

void Presence::watchStep() {
  const Timer::Time now = timer_.now();
  if (clock_.step() != watchedStep_) {
    watchedStep_ = clock_.step();
    stepBegan_ = now;
  }
  if (clock_.waitsFor().empty()) return;
  stepAlarm_.set(timer_, stepBegan_ + kStepTimeout, weak_from_this(), mutex_, &Presence::passOverLate);
}

void Presence::passOverLate() {
  if (timer_.now() >= stepBegan_ + kStepTimeout)
    for (const std::uint64_t late : std::set(clock_.waitsFor()))
      passOver(late, "because it was not done within " + std::to_string(kStepTimeout.count()) + " s");
  watchStep();
}

bool Presence::passOver(std::uint64_t camera, const std::string& why) {
  const std::string notice = "Member " + std::to_string(camera) + " was passed over at step " + std::to_string(clock_.step()) + ", " + why +
                             "; when it is done with the newest step, steps wait for it again.";
  if (!clock_.passOver(camera)) return false;
  clockChanged();
  for (const std::uint64_t told : {camera, clock_.owner()})
    if (const auto it = entries_.find(told); it != entries_.end() && it->second.wantsClock) sendClock(it->second, 0, notice);
  return true;
}

void Presence::noteClock() const {
  if (!observer_) return;
  const Timer::Time now = timer_.now();
  const wire::Clock clock = clock_.state(now);
  observer_->note(now, recording::Clocked{clock.mode, clock.rate, clock.time, clock.owner, clock.step});
}

void Presence::clockChanged() {
  noteClock();
  watchStep();
  for (auto& [id, entry] : entries_) entry.clockStale = entry.wantsClock;
  notifyOfClock();
}

void Presence::notifyOfClock() {
  bool all = true;
  for (auto& [id, entry] : entries_) {
    if (!entry.clockStale) continue;
    if (entry.clockWaiting.expired())
      sendClock(entry, 0);
    else
      all = false;
  }
  if (!all) clockAlarm_.set(timer_, timer_.now() + kClockRetry, weak_from_this(), mutex_, &Presence::notifyOfClock);
}

void Presence::sendClock(Entry& entry, std::uint64_t echo, std::string notice) {
  if (!entry.sender) return;  // a recording's member
  wire::Clock clock = clock_.state(timer_.now());
  clock.echo = echo;
  clock.notice = std::move(notice);
  entry.clockStale = false;
  const auto held = ticket();
  entry.clockWaiting = held;
  entry.sender->send(std::move(clock), held);
}

Presence::State Presence::state() const {
  const std::lock_guard lock(mutex_);
  State state;
  state.clock = clock_.state(timer_.now());
  for (const auto& [id, entry] : entries_) {
    state.members.push_back(entry.member);
    if (id == state.clock.owner) state.ownerName = entry.member.name;
  }
  return state;
}

}  // namespace ridgecast::session
