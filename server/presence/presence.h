#pragma once
// Who is in a session and where; notifies the members.
//
// A member that requested members is sent what has changed since its last notification in one message (news.h), not while the previous one
// is still queued, so for a slow member changes merge. Of its budget of bytes, if any, these messages take at most a quarter.
//
// | members of the session | a member that wants everybody, or wants near ones                             | messages a second, at most |
// |------------------------|-------------------------------------------------------------------------------|----------------------------|
// | kFew at most           | everybody; near ones often, within kBytesPerSecond                            | 20                         |
// | more                   | near ones often, others seldom, within kBytesPerSecond; everybody if the clock is stepped | 10             |
//
// In a stepped session, the owner and those who follow the clock are told what they are told often before a step begins, and again before
// it is said to be done: what they then read is of that step. Until they have it, no further step begins.
//
// Many members are told in turns: one turn holds the lock for about kTurn, and turns take at most half of the time.
//
// Over servers: each tells the others on a channel what its own members are and where, those that have changed 20 times a second and each
// at least once a second, which heals what was lost; in a stepped session also before it says that its members are done with a step, or
// that its owner steps. A member of another server that is not heard of for kSilence has left.
//
// Any thread. Messages are handed to the members' senders under a lock; senders do not call back.
// Bounds: one entry a member, with what it was told (news.h); kMaxMembers of other servers.

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/wire/messages.h"
#include "server/bus/bus.h"
#include "server/clock/session_clock.h"
#include "server/conversation/rate.h"
#include "server/conversation/sender.h"
#include "server/presence/crowd.h"
#include "server/presence/news.h"
#include "server/scheduling/timer.h"

namespace ridgecast::presence {

using conversation::Sender;
using scheduling::Alarm;

inline constexpr std::uint32_t kMaxMembers = 32'768;  // of a session

class Presence : public std::enable_shared_from_this<Presence> {
 public:
  static constexpr std::size_t kFew = 64;
  static constexpr std::size_t kMaxQueued = 3;  // messages of a member: one as ever, before a step was done, before the next begins
  static constexpr std::chrono::milliseconds kMinPause{50}, kPauseOfMany{100};
  static constexpr std::uint64_t kBytesPerSecond = 76'000;
  static constexpr std::chrono::seconds kRepeat{1}, kSilence{3};  // members told to other servers

  // `timer` must outlive this. `clock`: the session's; members join and leave it here.
  Presence(const Timer& timer, std::shared_ptr<clock::SessionClock> clock) : timer_(timer), clock_(std::move(clock)) {}
  ~Presence();
  Presence(const Presence&) = delete;
  Presence& operator=(const Presence&) = delete;

  // Before members here are told of a step: all servers' members are where they were by then.
  void tellForStep();
  // From now on, shows the members of other servers that share this channel, and tells them of its own. Once, if at all.
  void share(std::shared_ptr<bus::Bus> bus, std::string channel);

  // `hello` has its name, role and requests; `pose` is its newest. `world` is sent first: a client that has received it is a member, for
  // which steps wait. None: it was sent before, or there is no sender.
  void join(std::uint64_t camera, const wire::Hello& hello, std::shared_ptr<Sender> sender, const std::optional<wire::PoseMessage>& pose,
            std::optional<wire::World> world = {});
  void receive(std::uint64_t camera, const wire::PoseMessage& pose);  // unknown cameras are ignored, here and below
  void leave(std::uint64_t camera);
  // As the clock's, in its order among what is told of members.
  clock::Clock::Stepped step(std::uint64_t camera, const wire::ClockStep& step);
  void done(std::uint64_t camera, const wire::StepDone& done);
  void setBudget(std::uint64_t camera, std::uint64_t bytesPerSecond);  // 0: none
  // About the bytes of the member's notifications since the last call.
  std::size_t takeBytes(std::uint64_t camera);

  struct State {
    wire::Clock clock;
    std::string ownerName;
    std::vector<wire::Member> members;  // of all servers
  };
  State state() const;
  // Messages of other servers that were none.
  std::uint64_t malformed() const;

 private:
  struct Entry {
    Crowd::Participant* who = nullptr;
    std::shared_ptr<Sender> sender;
    bool wantsMembers = false;
    News news;
    std::optional<Timer::Time> due;                                                                    // in due_
    bool isIdle = false;                                                                               // in idle_
    Timer::Time notified{};                                                                            // when it was told last
    std::shared_ptr<std::atomic<std::size_t>> queued = std::make_shared<std::atomic<std::size_t>>(0);  // messages that have not left
    std::uint64_t bytesPerSecond = 0;                                                                  // of its messages; 0: unlimited
    conversation::Budget budget;
    std::size_t bytes = 0;  // not yet taken
    struct {
      std::uint64_t version = 0;
      Timer::Time at{};
    } shared;  // with other servers
  };

  void membersChanged();  // under the lock, as both below
  void notifyMembers();
  bool tellsAll(const Entry& entry) const;
  std::chrono::milliseconds pauseOf(const Entry& entry) const;
  void notify(Entry& entry, bool isForStep = false);
  void setAlarm(Timer::Time earliest);
  void schedule(Entry& entry, Timer::Time due);
  const CrowdPart& crowdPart();
  void remove(std::uint64_t camera);
  std::vector<std::string> toShare();  // under both locks
  void shareNow();                     // under telling_ alone
  void tick();
  void hear(const std::string& message);

  const Timer& timer_;
  const std::shared_ptr<clock::SessionClock> clock_;
  std::mutex telling_;  // other servers: what is told first is on its way first; taken before mutex_
  mutable std::mutex mutex_;
  Crowd crowd_;                                          // members of all servers
  std::map<std::uint64_t, Entry> entries_;               // of this one
  std::set<std::pair<Timer::Time, std::uint64_t>> due_;  // members to be notified, by when
  std::vector<std::uint64_t> idle_;                      // the other ones that want members, once the crowd changes
  CrowdPart crowdPart_;
  struct {
    Timer::Time at{};
    wire::Crowd counts;
  } counted_;
  std::shared_ptr<bus::Bus> bus_;  // null: nothing is shared
  std::string channel_;
  std::map<std::uint64_t, Timer::Time> heard_;  // members of other servers, last
  std::vector<std::uint64_t> left_;             // own ones, still to be told
  std::uint64_t malformed_ = 0;
  bool isFull_ = false;  // of members of other servers; logged
  Alarm membersAlarm_;
  bus::Subscription subscription_;  // the last to come, the first to go
};

}  // namespace ridgecast::presence
