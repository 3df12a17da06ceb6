#pragma once
// Who is in a session and where; notifies the members.
//
// A member that requested members is sent all changes since its last notification in one message: at most every kMinPause (20 times a
// second), and not while the previous one is still queued, so for a slow member changes merge. Of its budget of bytes, if any, these
// messages take at most a quarter.
//
// Any thread. Messages are handed to the members' senders under a lock; senders do not call back.
// Bounds: one entry a member; of departed members, at most those that it was notified of.

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/wire/messages.h"
#include "server/conversation/rate.h"
#include "server/session/sender.h"
#include "server/session/session_clock.h"
#include "server/session/timer.h"

namespace ridgecast::session {

class Presence : public std::enable_shared_from_this<Presence> {
 public:
  static constexpr std::chrono::milliseconds kMinPause{50};

  // `timer` must outlive this. `clock`: the session's; members join and leave it here.
  Presence(const Timer& timer, std::shared_ptr<SessionClock> clock) : timer_(timer), clock_(std::move(clock)) {}

  // `hello` has its name, role and requests; `pose` is its newest. `world` is sent first: a client that has received it is a member, for
  // which steps wait. None: it was sent before, or there is no sender.
  void join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, const std::optional<wire::PoseMessage>& pose,
            std::optional<wire::World> world = {});
  void receive(std::uint64_t camera, const wire::PoseMessage& pose);  // unknown cameras are ignored, here and below
  void leave(std::uint64_t camera);
  void setBudget(std::uint64_t camera, std::uint64_t bytesPerSecond);  // 0: none
  // About the bytes of the member's notifications since the last call.
  std::size_t takeBytes(std::uint64_t camera);

  struct State {
    wire::Clock clock;
    std::string ownerName;
    std::vector<wire::Member> members;
  };
  State state() const;

 private:
  struct Entry {
    wire::Member member;
    std::shared_ptr<Sender> sender;
    bool wantsMembers = false;
    std::uint64_t joinedAt = 0, movedAt = 0;  // versions
    // As of its last notification.
    std::uint64_t notified = 0;         // version
    std::vector<std::uint64_t> left;    // still to be sent
    std::weak_ptr<const void> waiting;  // the last Members, until it has left
    conversation::Budget budget;        // of Members
    std::size_t bytes = 0;              // not yet taken
  };

  void membersChanged();  // under the lock, as both below
  void notifyMembers();
  bool notify(Entry& entry);  // returns whether it is up to date

  const Timer& timer_;
  const std::shared_ptr<SessionClock> clock_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, Entry> entries_;
  std::uint64_t version_ = 0;
  Timer::Time lastNotified_{};
  Alarm membersAlarm_;
};

}  // namespace ridgecast::session
