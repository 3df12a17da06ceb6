#pragma once
// A session's clock and its members: takes what they say to it, and notifies those that follow it.
//
// A member that follows the clock is sent the current state once its previous message has left. A step that waits for a member always
// reaches it.
//
// A member that is not done with a step kStepTimeout after it began is passed over, as is one that the clock's owner names. That member and
// the owner get one sentence about it, as does a member whose message to the clock has no effect.
//
// The servers of a world share a session's clock (shared_clock.h). What a member says to it then takes effect, and is answered, once the
// engine has it. While the engine is away, settings and steps are refused with a sentence, and the clock goes on as it is.
//
// Setting a recording's clock back starts a successor session at that time; time never runs backwards within a session.
//
// Any thread. Messages are handed to the members' senders under a lock; senders do not call back. Bounds: one entry a member, and what
// shared_clock.h says.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "server/bus/bus.h"
#include "server/clock/calls.h"
#include "server/clock/clock.h"
#include "server/clock/shared_clock.h"
#include "server/conversation/sender.h"
#include "server/recording/events.h"
#include "server/scheduling/timer.h"

namespace ridgecast::clock {

using conversation::Sender;
using scheduling::Alarm;

class SessionClock : public std::enable_shared_from_this<SessionClock> {
 public:
  static constexpr std::chrono::milliseconds kRetry{5};  // while the last message to a member has not left
  static constexpr std::chrono::seconds kStepTimeout = clock::kStepTimeout;

  // `timer` must outlive this. `mode`: how the clock begins, in real time or stepped. `observer`: told of changes; null: nobody.
  explicit SessionClock(const Timer& timer, wire::ClockMode mode = wire::ClockMode::kRealTime,
                        std::shared_ptr<recording::Observer> observer = {});
  ~SessionClock();
  SessionClock(const SessionClock&) = delete;
  SessionClock& operator=(const SessionClock&) = delete;

  // From now on it is one clock with those of other servers that share this key. Before anybody joins; once, if at all.
  // `beforeStep` is called, without a lock, before members here are told that a step is done or has begun.
  void share(std::shared_ptr<bus::Bus> bus, std::string key, std::function<void()> beforeStep = {});
  // The session is over: if no other server has it, the engine forgets the clock.
  void end() { end(true); }
  // This server has the session no longer. The engine keeps the clock, for the next one.
  void leave() { end(false); }

  // The session is a recording: its clock has this time, mode, rate and end. `goBack` is called with the time, in microseconds, that its
  // owner wants to go back to; it does not call back.
  void play(const wire::Clock& recording, std::function<void(std::uint64_t time)> goBack);

  // Presence calls both. `world`, if any, is sent first: steps wait for each client that has received it and follows the clock.
  void join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, std::optional<wire::World> world);
  void leave(std::uint64_t camera);

  // Unknown members are ignored, here and below.
  void receive(std::uint64_t camera, const wire::AskClock& ask);
  // Answers with the resulting clock, changed or not.
  void receive(std::uint64_t camera, const wire::SetClock& set);
  Clock::Stepped step(std::uint64_t camera, const wire::ClockStep& step);
  void receive(std::uint64_t camera, const wire::StepDone& done);
  void receive(std::uint64_t camera, const wire::PassOver& pass);

  // A sentence for the people at all members with `members` or `clock` in hello, as Clock.notice; cut to wire::kMaxErrorBytes.
  void tell(std::string sentence);
  // Why what this member said has no effect.
  void refuse(std::uint64_t camera, std::string sentence);

  // What it says is the clock of all servers, or they cannot be reached.
  bool isCurrent() const;
  wire::Clock state() const;
  std::uint64_t time() const;                 // microseconds
  std::set<std::uint64_t> listeners() const;  // those who follow the clock, and its owner
  // The clock is stepped, this is the newest step, and of this server's members it waits for nobody but this one.
  bool endsStepHere(std::uint64_t camera, std::uint64_t step) const;
  // The clock is stepped, and this owner's next step begins at once.
  bool beginsStep(std::uint64_t camera) const;

 private:
  struct Entry {
    std::shared_ptr<Sender> sender{};
    bool follows = false, hears = false;  // the clock; sentences to all
    bool isStale = false;                 // the last message said another state
    std::weak_ptr<const void> waiting{};  // that message, until it has left
  };

  using Lock = std::unique_lock<std::mutex>;

  void end(bool forgets);
  bool refuses(Entry& entry);  // the engine is away, and the member is told; under the lock, as all below
  const Clock& shown() const { return shared_ ? shared_->clock() : clock_; }
  wire::Clock now() const;
  void changed();
  void note() const;
  void notify();
  void send(Entry& entry, std::uint64_t echo, std::string notice = {}, bool isRefusal = false);
  void sendAll(const std::vector<Notice>& notices);
  void watchStep();
  void passOverLate();
  // Shared:
  SharedClock::Now sharedNow() const;
  template <class Use>
  void use(const Use& use);                      // without the lock
  void settle(Lock& lock);                       // what came of a call to shared_
  void carryOut(const SharedClock::Wish& wish);  // without the lock
  template <class Said>
  void announceStep(const Said& said) const;  // if it turns one; without the lock
  void setTick();

  const Timer& timer_;
  const std::shared_ptr<recording::Observer> observer_;
  mutable std::mutex mutex_;
  std::map<std::uint64_t, Entry> entries_;
  Alarm notifyAlarm_, stepAlarm_;
  Clock clock_;
  std::function<void(std::uint64_t time)> goBack_;  // of a recording
  std::uint64_t watchedStep_ = 0;
  Timer::Time stepBegan_{};  // that one

  std::shared_ptr<bus::Bus> bus_;  // null: nothing is shared, and clock_ is the clock
  std::string key_;
  std::function<void()> beforeStep_;
  std::string problem_;  // the last that was logged
  std::optional<SharedClock> shared_;
  std::deque<SharedClock::Wish> wishes_;
  bool isCarryingOut_ = false;
  std::atomic<bool> isOver_ = false;
  bus::Subscription told_, calls_;
};

}  // namespace ridgecast::clock
