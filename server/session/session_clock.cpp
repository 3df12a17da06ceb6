#include "server/session/session_clock.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"

namespace ridgecast::session {

SessionClock::SessionClock(const Timer& timer, wire::ClockMode mode, std::shared_ptr<recording::Observer> observer)
    : timer_(timer), observer_(std::move(observer)), clock_(timer.now(), mode) {
  note();
}

void SessionClock::play(const wire::Clock& recording, std::function<void(std::uint64_t time)> goBack) {
  const std::lock_guard lock(mutex_);
  goBack_ = std::move(goBack);
  clock_.play(recording, timer_.now());
  changed();
}

void SessionClock::join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, std::optional<wire::World> world) {
  const std::lock_guard lock(mutex_);
  expects(!entries_.contains(camera), "a member joins the clock once");
  Entry& entry = entries_[camera];
  entry = {std::move(sender), hello.clock, hello.members || hello.clock};
  if (world) entry.sender->send(std::move(*world));
  if (!entry.follows) return;
  clock_.follow(camera);
  send(entry, 0);
}

void SessionClock::leave(std::uint64_t camera) {
  const std::lock_guard lock(mutex_);
  if (entries_.erase(camera) > 0 && clock_.leave(camera, timer_.now())) changed();
}

void SessionClock::receive(std::uint64_t camera, const wire::AskClock& ask) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) send(it->second, ask.echo);
}

void SessionClock::receive(std::uint64_t camera, const wire::SetClock& set) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  const Timer::Time now = timer_.now();
  const bool isChanged = clock_.set(camera, set, now);
  if (isChanged) changed();
  const bool goesBack = isChanged && set.own && set.time != 0 && set.time < clock_.time(now);
  if (goesBack && goBack_) goBack_(set.time);
  std::string notice;
  if (!isChanged) notice = whyNotYours();
  if (goesBack && !goBack_) notice = "Time goes back only in recordings.";
  if (isChanged && set.own && clock_.isTooFarAhead(set.time, now))
    notice = "A jump takes the clock at most an hour ahead, and to at most 142 years.";
  if (!notice.empty() || !it->second.follows) send(it->second, 0, std::move(notice));
}

Clock::Stepped SessionClock::step(std::uint64_t camera, const wire::ClockStep& step) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return Clock::Stepped::kNotYours;
  const Clock::Stepped stepped = clock_.step(camera, step);
  if (stepped == Clock::Stepped::kBegins) changed();
  if (stepped == Clock::Stepped::kNotYours) send(it->second, 0, whyNotYours());
  return stepped;
}

void SessionClock::receive(std::uint64_t camera, const wire::StepDone& done) {
  const std::lock_guard lock(mutex_);
  if (clock_.done(camera, done.step)) changed();
}

void SessionClock::receive(std::uint64_t camera, const wire::PassOver& pass) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  if (clock_.owner() != camera) return send(it->second, 0, whyNotYours());
  if (passOver(pass.camera, "by the clock's owner")) return;
  send(it->second, 0,
       "No step waits for member " + std::to_string(pass.camera) + ": it does not follow the clock or was passed over before.");
}

void SessionClock::tell(std::string sentence) {
  sentence.resize(std::min<std::size_t>(sentence.size(), wire::kMaxErrorBytes));
  const std::lock_guard lock(mutex_);
  for (auto& [id, entry] : entries_)
    if (entry.hears) send(entry, 0, sentence);
}

void SessionClock::tell(std::uint64_t camera, std::string sentence) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) send(it->second, 0, std::move(sentence));
}

wire::Clock SessionClock::state() const {
  const std::lock_guard lock(mutex_);
  return clock_.state(timer_.now());
}

std::uint64_t SessionClock::time() const {
  const std::lock_guard lock(mutex_);
  return clock_.time(timer_.now());
}

std::string SessionClock::whyNotYours() const {
  if (clock_.owner() == 0) return "Nobody owns the clock: take it with set clock first.";
  return "The clock belongs to member " + std::to_string(clock_.owner()) + ": only its owner sets and steps it.";
}

void SessionClock::watchStep() {
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
    for (const std::uint64_t late : std::set(clock_.waitsFor()))
      passOver(late, "because it was not done within " + std::to_string(kStepTimeout.count()) + " s");
  watchStep();
}

bool SessionClock::passOver(std::uint64_t camera, const std::string& why) {
  const std::string notice = "Member " + std::to_string(camera) + " was passed over at step " + std::to_string(clock_.step()) + ", " + why +
                             "; when it is done with the newest step, steps wait for it again.";
  if (!clock_.passOver(camera)) return false;
  changed();
  for (const std::uint64_t told : {camera, clock_.owner()})
    if (const auto it = entries_.find(told); it != entries_.end() && it->second.follows) send(it->second, 0, notice);
  return true;
}

void SessionClock::note() const {
  if (!observer_) return;
  const Timer::Time now = timer_.now();
  const wire::Clock clock = clock_.state(now);
  observer_->note(now, recording::Clocked{clock.mode, clock.rate, clock.time, clock.owner, clock.step});
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

void SessionClock::send(Entry& entry, std::uint64_t echo, std::string notice) {
  if (!entry.sender) return;  // a recording's member
  wire::Clock clock = clock_.state(timer_.now());
  clock.echo = echo;
  clock.notice = std::move(notice);
  entry.isStale = false;
  const std::shared_ptr<const void> held = std::make_shared<char>();
  entry.waiting = held;
  entry.sender->send(std::move(clock), held);
}

}  // namespace ridgecast::session
