#pragma once
// One server's part of a clock that the servers of a world share. It neither waits nor sends: it takes what is heard, answered and due, and
// says what to send. Not thread-safe.
//
//   member --call--> its server --calls--> leader --record--> engine
//                                          leader --told----> all servers --clock--> members
//
// The clock is a record in the engine (server/bus/bus.h). One server leads: it applies all servers' calls to its copy, writes that, and
// tells it to the others once it is written. What was told is thus in the record, and whoever leads next goes on with it: it takes the
// record over from a leader that it has not heard for kSilence, and from then on the engine refuses the earlier leader's writes. While one
// write is on its way, further calls gather for the next. All servers show the record that they know, by the engine's time.
//
//            none there, written                not heard for kSilence, taken
//   seeking ---------------------> leading <-------------------------------- mirroring
//      |                              | refused, or a later epoch was heard    ^  ^
//      |                              +----------------------------------------+  |
//      +--------------------------------------------------------------------------+  there is one
//
// Calls are numbered, repeated until the record says that they were applied, and applied once, in order. A leader drops the members of a
// server that was not heard for kSilence: of the leader before it at once, if it has waited for that one. Back again, the server tells all
// its members. Settings and steps that it had on the way then have no effect: they are not repeated, and their members get a sentence.
//
// Time does not go back for a server's members, whatever the engine's time does: a clock that ran ahead stands until the others have come,
// and if they would not come soon, they are moved. Until it knows the record it stands at 0.
//
// While the engine is away nobody leads: all go on by the record.
// A step waits for the members of other servers that followed when the leader heard of it, some milliseconds after their World.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "server/bus/bus.h"
#include "server/clock/calls.h"
#include "server/clock/clock.h"
#include "server/clock/messages.h"
#include "server/scheduling/timer.h"

namespace ridgecast::clock {

using scheduling::Timer;

class SharedClock {
 public:
  static constexpr std::chrono::milliseconds kTick{250};  // between calls of tick()
  static constexpr std::chrono::seconds kHeartbeat{1}, kSilence{3}, kMaxPause{2};
  static constexpr std::chrono::hours kLife{24};    // of the record, after the last write: longer than all servers take to restart
  static constexpr std::size_t kMaxPending = 4096;  // calls that were not applied yet
  static constexpr std::size_t kMaxNotices = 1024;  // on their way; further ones are dropped
  static constexpr std::size_t kMaxGone = 64;       // servers that are remembered after they went, so that nothing of theirs is repeated

  struct Now {
    Timer::Time here;       // for what is awaited
    Clock::Instant engine;  // for the clock
    bool isAway;            // the engine
  };
  // To be done in order, without a lock that a handler takes.
  struct Wish {
    enum class Kind { kHold, kTake, kTell, kCall } kind;
    std::string value{};  // of the record; the message
    std::uint64_t epoch = 0;
  };
  // What came of a call to this.
  struct News {
    bool isChanged = false;                 // what followers are notified of
    std::vector<Notice> notices{};          // for members here or elsewhere
    std::vector<std::uint64_t> answered{};  // members here whose setting was applied or refused
    std::string problem{};                  // one sentence for the log
    std::vector<Wish> wishes{};
  };

  // `mode`: how the clock begins if the engine knows none.
  SharedClock(std::uint32_t server, wire::ClockMode mode, Now now);

  const Clock& clock() const { return shown_.clock; }
  std::uint64_t time(const Now& now) const;  // microseconds
  wire::Clock state(const Now& now) const;
  // Of this member, that are not applied yet.
  std::size_t pendingSteps(std::uint64_t member) const;
  // Of these members, those that the step waits for, but for those whose kDone is not applied yet.
  std::set<std::uint64_t> undone(const std::function<bool(std::uint64_t member)>& isHere) const;
  // Whether heardTold() or answered() would show that a step is done, or has begun.
  bool turnsStep(const Outcome<Told>& told) const;
  bool turnsStep(const Outcome<bus::Bus::Held>& answer) const;

  void call(const Call& call, const Now& now);
  void heardTold(Outcome<Told> told, const Now& now);
  void heardCalls(const std::string& bytes, const Now& now);
  // To the wish kHold or kTake; one is open at a time.
  void answered(Outcome<bus::Bus::Held> answer, const Now& now);
  void tick(const Now& now);
  // The last wishes: others need not wait for this server.
  void end();

  News takeNews() { return std::exchange(news_, {}); }

  bool isLeading() const { return role_ == Role::kLeading; }
  bool leadsAlone() const { return isLeading() && heard_.empty(); }
  std::uint64_t epoch() const { return epoch_; }
  std::uint64_t version() const { return shown_.version; }

 private:
  enum class Role { kSeeking, kMirroring, kLeading };
  enum class Asked { kNothing, kHold, kTake };
  enum class Write { kNot, kSoon, kNow };  // soon: at the next tick

  static std::uint64_t microsecondsOf(Clock::Instant instant);
  void announce(const Now& now, bool isFull = false);
  void forget(std::uint64_t applied);
  void add(ToldCalls::Numbered numbered, const Now& now);
  void sendCalls(std::size_t from, const Now& now);
  void acknowledge(const Now& now);
  void show(Record record, const Now& now);
  bool show(const std::string& bytes, const Now& now);
  bool isOther(const Record& record) const;
  bool turnsStep(const Record& next) const;
  void seek(const Now& now);
  void lead(const Now& now);
  void mirror(const bus::Record& record, const Now& now);
  // Leading:
  void applyTo(std::uint32_t server, const std::vector<ToldCalls::Numbered>& calls, const Now& now);
  void replace(std::set<std::uint64_t>& members, const std::vector<ToldCalls::Member>& all, const Now& now);
  void applyOne(std::set<std::uint64_t>& members, const Call& call, const Now& now);
  void took(Effect effect, Write write);
  void add(Notice notice);
  void remove(std::uint32_t server, const Now& now);
  void write(const Now& now);
  void tell(std::vector<Notice> notices, const Now& now);
  void tickMirroring(const Now& now);
  void tickLeading(const Now& now);
  bool wasShownFarAheadOf(const Clock& clock, const Now& now) const;
  void keepAhead(const Now& now);

  const std::uint32_t self_;
  const wire::ClockMode mode_;
  Role role_ = Role::kSeeking;
  Asked asked_ = Asked::kNothing;
  std::uint64_t epoch_ = 0;            // of the record, as far as known
  Record shown_;                       // the last that is known to be in the engine; version 0: none
  mutable std::uint64_t reached_ = 0;  // the latest time that was asked for here
  News news_;
  bool wasAway_ = false;
  bool isUnreadable_ = false;  // the record: another version of the program wrote it

  // This server's calls.
  std::map<std::uint64_t, bool> members_;                        // that follow the clock (true) or have set it
  std::deque<ToldCalls::Numbered> pending_;                      // not known to be applied
  std::uint64_t lastNumber_, announced_ = 0, acknowledged_ = 0;  // of calls: the last; the last that told all members; the last applied
  Timer::Time repeatAt_{};
  std::chrono::milliseconds pause_{kTick};

  // Others that have this clock, by their calls (the leader sends none), and when they were heard last.
  std::map<std::uint32_t, Timer::Time> heard_;

  // Mirroring: when the leader was heard, and told, last.
  Timer::Time leaderHeard_, toldLeader_{};
  bool isLeaderBehind_ = false;  // it does not know what is shown here, which the engine has lost

  // Leading.
  Record next_;  // with calls that are not written yet
  Record writing_;
  std::vector<Notice> notices_, writingNotices_;  // told with those
  Write write_ = Write::kNot;
  bool isNew_ = false;  // nothing was written yet, and a leader of before may not know that it leads no longer
  Timer::Time told_{}, written_{}, stepBegan_{};
  std::uint64_t watchedStep_ = 0;
};

}  // namespace ridgecast::clock
