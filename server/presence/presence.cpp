#include "server/presence/presence.h"

#include <algorithm>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/logging/logging.h"
#include "server/presence/members_messages.h"

namespace ridgecast::presence {

namespace {

constexpr std::size_t kMostCells = 512;         // told of a crowd
constexpr std::size_t kGoneAtOnce = 64;         // silent members that go at a time
constexpr std::chrono::seconds kCrowdPause{2};  // between two other crowds

}  // namespace

void Presence::join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender,
                    const std::optional<wire::PoseMessage>& pose, std::optional<wire::World> world) {
  const std::lock_guard lock(mutex_);
  expects(!entries_.contains(camera), "a member joins once");
  expects(camera != 0 && (sender || !world), "a member has a number, and a way to it if it is told of the world");
  if (heard_.erase(camera) > 0) remove(camera);
  Entry& entry = entries_[camera];
  wire::Member member{camera, hello.role, hello.clientName, {}, hello.clock};
  if (pose) member.moved = wire::Moved{camera, *pose, clock_->time()};
  entry.who = &crowd_.add(std::move(member));
  entry.sender = std::move(sender);
  entry.wantsMembers = hello.members && entry.sender;
  entry.news = News(hello);
  entry.isIdle = entry.wantsMembers;
  if (entry.isIdle) idle_.push_back(camera);
  clock_->join(camera, hello, entry.sender, std::move(world));
  membersChanged();
}

void Presence::receive(std::uint64_t camera, const wire::PoseMessage& pose) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  crowd_.move(*it->second.who, {camera, pose, clock_->time()});
  membersChanged();
}

void Presence::leave(std::uint64_t camera) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  if (it->second.due) due_.erase({*it->second.due, camera});
  if (it->second.isIdle) std::erase(idle_, camera);
  entries_.erase(it);
  if (bus_) left_.push_back(camera);
  remove(camera);
  clock_->leave(camera);
}

void Presence::setBudget(std::uint64_t camera, std::uint64_t bytesPerSecond) {
  const std::lock_guard lock(mutex_);
  if (const auto it = entries_.find(camera); it != entries_.end()) it->second.bytesPerSecond = bytesPerSecond / 4;
}

std::size_t Presence::takeBytes(std::uint64_t camera) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  return it == entries_.end() ? 0 : std::exchange(it->second.bytes, 0);
}

void Presence::remove(std::uint64_t camera) {
  crowd_.remove(camera);
  for (auto& [id, entry] : entries_)
    if (entry.wantsMembers) entry.news.forget(camera);
  membersChanged();
}

void Presence::membersChanged() {
  for (const std::uint64_t camera : std::exchange(idle_, {}))
    if (const auto it = entries_.find(camera); it != entries_.end()) {
      it->second.isIdle = false;
      schedule(it->second, it->second.notified + pauseOf(it->second));
    }
  setAlarm(timer_.now());
}

// At the first that is due, but not before this time.
void Presence::setAlarm(Timer::Time earliest) {
  if (due_.empty()) return;
  const Timer::Time latest = std::max(earliest, timer_.now() + kMinPause);
  membersAlarm_.set(timer_, std::clamp(due_.begin()->first, earliest, latest), weak_from_this(), mutex_, &Presence::notifyMembers);
}

// Then, or as early as before.
void Presence::schedule(Entry& entry, Timer::Time due) {
  const std::uint64_t camera = entry.who->member().camera;
  if (entry.due && *entry.due <= due) return;
  if (entry.due) due_.erase({*entry.due, camera});
  entry.due = due;
  due_.emplace(due, camera);
}

void Presence::notifyMembers() {
  const Timer::Time began = timer_.now();
  Timer::Time now = began;
  while (!due_.empty() && due_.begin()->first <= began && now < began + scheduling::kTurn) {
    Entry& entry = entries_.at(due_.begin()->second);
    due_.erase(due_.begin());
    entry.due.reset();
    notify(entry);
    now = timer_.now();
  }
  setAlarm(std::min(now + (now - began), now + kMinPause));
}

bool Presence::tellsAll(const Entry& entry) const {
  return entry.news.wantsEverybody() && (crowd_.size() <= kFew || clock_->state().mode == wire::ClockMode::kStepped);
}

std::chrono::milliseconds Presence::pauseOf(const Entry& entry) const {
  return crowd_.size() <= kFew || tellsAll(entry) ? kMinPause : kPauseOfMany;
}

clock::Clock::Stepped Presence::step(std::uint64_t camera, const wire::ClockStep& step) {
  const std::lock_guard telling(telling_);
  if (clock_->beginsStep(camera)) bus_ ? shareNow() : tellForStep();
  return clock_->step(camera, step);
}

void Presence::done(std::uint64_t camera, const wire::StepDone& done) {
  const std::lock_guard telling(telling_);
  if (clock_->endsStepHere(camera, done.step)) bus_ ? shareNow() : tellForStep();
  clock_->receive(camera, done);
}

void Presence::tellForStep() {
  const std::lock_guard lock(mutex_);
  for (const std::uint64_t camera : clock_->listeners()) {
    const auto it = entries_.find(camera);
    if (it == entries_.end() || !it->second.wantsMembers) continue;
    Entry& entry = it->second;
    if (entry.due) due_.erase({*std::exchange(entry.due, std::nullopt), camera});
    notify(entry, true);
  }
  setAlarm(timer_.now());
}

// `isForStep`: at once, for no step waits for what is told later.
void Presence::notify(Entry& entry, bool isForStep) {
  const Timer::Time now = timer_.now();
  const bool all = tellsAll(entry);
  const auto pause = pauseOf(entry);
  std::uint64_t rate = entry.bytesPerSecond;
  if (!all) rate = std::min(rate == 0 ? kBytesPerSecond : rate, kBytesPerSecond);
  entry.budget.setRate(rate);
  if (*entry.queued >= (isForStep ? kMaxQueued : 1)) return schedule(entry, now + kMinPause);
  if (!isForStep && entry.budget.limits() && entry.budget.free() > now) return schedule(entry, entry.budget.free());
  const std::size_t measure = rate * static_cast<std::uint64_t>(pause.count()) / 1000;
  if (const auto parts = entry.news.next(crowd_, *entry.who, {all, measure, crowdPart()}, now)) {
    auto bytes = std::make_shared<const std::string>(wire::encodeMembers(*parts));
    entry.budget.spend(now, bytes->size());
    entry.bytes += bytes->size();
    ++*entry.queued;
    entry.sender->sendShared(std::move(bytes), conversation::ticketOf(entry.queued));
  }
  entry.notified = now;
  if (const auto due = entry.news.due(crowd_)) schedule(entry, std::max({*due, now + pause, entry.budget.free()}));
  if (!std::exchange(entry.isIdle, true)) idle_.push_back(entry.who->member().camera);
}

const CrowdPart& Presence::crowdPart() {
  const Timer::Time now = timer_.now();
  if (crowdPart_.version == crowd_.version() || now < counted_.at + kCrowdPause) return crowdPart_;
  crowdPart_.version = crowd_.version();
  counted_.at = now;
  wire::Crowd counts = crowd_.size() - 1 > News::kNamed ? crowd_.counts(kMostCells) : wire::Crowd();
  if (crowdPart_.number != 0 && counts == counted_.counts) return crowdPart_;
  wire::Members part;
  part.crowd = counted_.counts = std::move(counts);
  ++crowdPart_.number;
  crowdPart_.bytes = wire::encodePart(part);
  return crowdPart_;
}

Presence::State Presence::state() const {
  const std::lock_guard lock(mutex_);
  State state;
  state.clock = clock_->state();
  for (const auto& [id, who] : crowd_.all()) state.members.push_back(who.member());
  if (const auto* owner = crowd_.find(state.clock.owner)) state.ownerName = owner->member().name;
  return state;
}

// ---- other servers ----

void Presence::share(std::shared_ptr<bus::Bus> bus, std::string channel) {
  expects(bus && !bus_, "members are shared once");
  {
    const std::lock_guard lock(mutex_);
    bus_ = std::move(bus);
    channel_ = std::move(channel);
  }
  subscription_ = bus_->hear(channel_, [weak = weak_from_this()](const std::string& message) {
    if (const auto self = weak.lock()) self->hear(message);
  });
  tick();
}

Presence::~Presence() {
  if (!bus_) return;
  for (const auto& [camera, entry] : entries_) left_.push_back(camera);
  MembersMessages messages;
  for (const std::uint64_t camera : left_) messages.left(camera);
  for (std::string& message : messages.take()) bus_->tell(channel_, std::move(message));
}

std::vector<std::string> Presence::toShare() {
  const Timer::Time now = timer_.now();
  MembersMessages messages;
  for (const std::uint64_t camera : std::exchange(left_, {})) messages.left(camera);
  for (auto& [camera, entry] : entries_) {
    if (entry.shared.version == entry.who->version() && now < entry.shared.at + kRepeat) continue;
    entry.shared = {entry.who->version(), now};
    messages.add(entry.who->member());
  }
  std::vector<std::uint64_t> gone;
  for (const auto& [camera, at] : heard_)
    if (now >= at + kSilence && gone.size() < kGoneAtOnce) gone.push_back(camera);
  for (const std::uint64_t camera : gone) {
    heard_.erase(camera);
    remove(camera);
  }
  return messages.take();
}

// A bus may call handlers of others amid its tell(), and they have locks of their own.
void Presence::shareNow() {
  std::vector<std::string> messages;
  {
    const std::lock_guard lock(mutex_);
    messages = toShare();
  }
  for (std::string& message : messages) bus_->tell(channel_, std::move(message));
}

void Presence::tick() {
  {
    const std::lock_guard telling(telling_);
    shareNow();
  }
  timer_.at(timer_.now() + kMinPause, [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->tick();
  });
}

void Presence::hear(const std::string& message) {
  auto heard = membersOf(message);
  const std::lock_guard lock(mutex_);
  if (!heard) {
    if (malformed_++ == 0) logging::warning({}, "a message about the members of another server is ignored: " + heard.error().message);
    return;
  }
  const Timer::Time now = timer_.now();
  for (wire::Member& member : heard->joined) {
    const std::uint64_t camera = member.camera;
    if (entries_.contains(camera)) continue;
    Crowd::Participant* known = crowd_.find(camera);
    if (!known && heard_.size() >= kMaxMembers) {
      if (!std::exchange(isFull_, true))
        logging::warning({}, "more than " + std::to_string(kMaxMembers) + " members are on other servers; some are not shown");
      continue;
    }
    heard_[camera] = now;
    if (!known)
      crowd_.add(std::move(member));
    else if (member.moved && known->member().moved != member.moved)
      crowd_.move(*known, std::move(*member.moved));
  }
  for (const std::uint64_t camera : heard->left)
    if (heard_.erase(camera) > 0) remove(camera);
  membersChanged();
}

std::uint64_t Presence::malformed() const {
  const std::lock_guard lock(mutex_);
  return malformed_;
}

}  // namespace ridgecast::presence
