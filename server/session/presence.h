#pragma once
// Who is in a session and where, and its clock; notifies the members of both.
//
// A member that requested members is sent all changes since its last notification in one message: at most every kMinPause (20 times a
// second), and not while the previous one is still queued, so for a slow member changes merge. Of its budget of bytes, if any, these
// messages take at most a quarter. A member that follows the clock is sent the current state once its previous message has left. A step
// that waits for a member always reaches it.
//
// A member that is not done with a step kStepTimeout after it began is passed over, as is one that the clock's owner names. That member and
// the owner get one sentence about it, as does a member whose message to the clock has no effect.
//
// Setting a recording's clock back starts a successor session at that time; time never runs backwards within a session.
//
// Any thread. Messages are handed to the members' senders under a lock; senders do not call back.
// Bounds: one entry a member; of departed members, at most those that it was notified of.

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "server/conversation/rate.h"
#include "server/recording/events.h"
#include "server/session/clock.h"
#include "server/session/sender.h"
#include "server/session/timer.h"

namespace ridgecast::session {

class Presence : public std::enable_shared_from_this<Presence> {
 public:
  static constexpr std::chrono::milliseconds kMinPause{50};
  static constexpr std::chrono::milliseconds kClockRetry{5};  // retry interval while the last message about the clock has not left

  static constexpr std::chrono::seconds kStepTimeout{30};

  // `timer` must outlive this. `clock`: how the clock begins, in real time or stepped. `observer`: told of the clock; null: nobody.
  explicit Presence(const Timer& timer, wire::ClockMode clock = wire::ClockMode::kRealTime,
                    std::shared_ptr<recording::Observer> observer = {});

  // The session is a recording: its clock has this time, mode, rate and end. `goBack` is called with the time, in microseconds, that its
  // owner wants to go back to; it does not call back.
  void play(const wire::Clock& recording, std::function<void(std::uint64_t time)> goBack);

  // `hello` has its name, role and requests; `pose` is its newest. `world` is sent first: a client that has received it is a member, for
  // which steps wait. None: it was sent before, or there is no sender.
  void join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, const std::optional<wire::PoseMessage>& pose,
            std::optional<wire::World> world = {});
  void receive(std::uint64_t camera, const wire::PoseMessage& pose);  // unknown cameras are ignored, here and below
  void leave(std::uint64_t camera);
  void setBudget(std::uint64_t camera, std::uint64_t bytesPerSecond);  // 0: none
  // About the bytes of the member's notifications since the last call.
  std::size_t takeBytes(std::uint64_t camera);

  void receive(std::uint64_t camera, const wire::AskClock& ask);
  // Answers with the resulting clock, changed or not.
  void receive(std::uint64_t camera, const wire::SetClock& set);
  Clock::Stepped step(std::uint64_t camera, const wire::ClockStep& step);
  void receive(std::uint64_t camera, const wire::StepDone& done);
  void receive(std::uint64_t camera, const wire::PassOver& pass);

  // A sentence for the people at this member, or at all members with `members` or `clock` in hello, as Clock.notice; cut to
  // wire::kMaxErrorBytes.
  void tell(std::string sentence);
  void tell(std::uint64_t camera, std::string sentence);

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
    bool wantsMembers = false, wantsClock = false;
    std::uint64_t joinedAt = 0, movedAt = 0;  // versions
    // As of its last notification.
    std::uint64_t notified = 0;         // version
    std::vector<std::uint64_t> left;    // still to be sent
    std::weak_ptr<const void> waiting;  // the last Members, until it has left
    conversation::Budget budget;        // of Members
    std::size_t bytes = 0;              // not yet taken
    bool clockStale = false;
    std::weak_ptr<const void> clockWaiting;
  };

  void membersChanged();  // under the lock, as all below
  void notifyMembers();
  bool notify(Entry& entry);  // returns whether it is up to date
  void clockChanged();
  void noteClock() const;
  void notifyOfClock();
  void sendClock(Entry& entry, std::uint64_t echo, std::string notice = {});
  std::string whyNotYours() const;
  void watchStep();
  void passOverLate();
  bool passOver(std::uint64_t camera, const std::string& why);  // false: no step waits for it anyway

  const Timer& timer_;
  const std::shared_ptr<recording::Observer> observer_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, Entry> entries_;
  std::uint64_t version_ = 0;
  Timer::Time lastNotified_{};
  Alarm membersAlarm_, clockAlarm_, stepAlarm_;
  Clock clock_;
  std::function<void(std::uint64_t time)> goBack_;  // of a recording
  std::uint64_t watchedStep_ = 0;
  Timer::Time stepBegan_{};  // that one
};

}  // namespace ridgecast::session
