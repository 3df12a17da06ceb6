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

void Presence::join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender,
                    const std::optional<wire::PoseMessage>& pose, std::optional<wire::World> world) {
  const std::lock_guard lock(mutex_);
  expects(!entries_.contains(camera), "a member joins once");
  expects(camera != 0 && (sender || !world), "a member has a number, and a way to it if it is told of the world");
  Entry& entry = entries_[camera];
  entry.member = {camera, hello.role, hello.clientName, {}};
  entry.sender = std::move(sender);
  entry.wantsMembers = hello.members;
  entry.joinedAt = ++version_;
  if (pose) {
    entry.member.moved = wire::Moved{camera, *pose, clock_->time()};
    entry.movedAt = version_;
  }
  clock_->join(camera, hello, entry.sender, std::move(world));
  membersChanged();
}

void Presence::receive(std::uint64_t camera, const wire::PoseMessage& pose) {
  const std::lock_guard lock(mutex_);
  const auto it = entries_.find(camera);
  if (it == entries_.end()) return;
  it->second.member.moved = wire::Moved{camera, pose, clock_->time()};
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
  clock_->leave(camera);
}

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

Presence::State Presence::state() const {
  const std::lock_guard lock(mutex_);
  State state;
  state.clock = clock_->state();
  for (const auto& [id, entry] : entries_) {
    state.members.push_back(entry.member);
    if (id == state.clock.owner) state.ownerName = entry.member.name;
  }
  return state;
}

}  // namespace ridgecast::session
