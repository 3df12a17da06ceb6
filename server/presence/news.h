#pragma once
// What one member has been told of the others, and what it is told next.
//
// Each message tells:
//   all of the nearest that have changed (kNear, or as many as the member wants), so that they are told as often as messages are sent;
//   then, in passes that begin once a second, the others that the member knows by name, as far as the message's bytes go.
//
// Named are the kNamed nearest; one is named until it is not among the kFar nearest, so that few come and go. All that are not named are
// told as counts (Crowd). A member that wants to know everybody (Hello.near is 0) has all named, at most kMaxNamed.
//
// Not thread-safe. Bounds: about kFar entries, for a member that wants everybody kMaxNamed; one message's bytes beyond their measure by at
// most one entry, but for the nearest.

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/messages.h"
#include "server/presence/crowd.h"
#include "server/scheduling/timer.h"

namespace ridgecast::presence {

using scheduling::Timer;

// Counts of a crowd, encoded once for all that are told.
struct CrowdPart {
  std::uint64_t number = 0;   // grows with each other one
  std::uint64_t version = 0;  // of the crowd that was counted
  std::string bytes;          // wire::encodePart
};

class News {
 public:
  static constexpr std::size_t kNear = 24, kNamed = 64, kFar = 96, kMaxNamed = 4096;
  static constexpr std::chrono::seconds kPass{1};

  News() = default;
  explicit News(const wire::Hello& hello)
      : wantsEverybody_(hello.near == 0),
        states_(hello.near == 0 || hello.states),
        near_(hello.near == 0 ? kNear : std::min<std::size_t>(hello.near, kNamed)) {}

  bool wantsEverybody() const { return wantsEverybody_; }

  struct Terms {
    bool all = false;        // everybody that has changed, as the nearest; only if it wants everybody
    std::size_t bytes = 0;   // measure of this message: what the nearest leave of it, but a share in any case, is for the others
    const CrowdPart& crowd;  // newest
  };
  // The parts of a Members (wire::encodeMembers); nothing: there is no news. The first may be empty.
  std::optional<std::string> next(const Crowd& crowd, const Crowd::Participant& self, const Terms& terms, Timer::Time now);

  // The member `camera` has left the session.
  void forget(std::uint64_t camera);

  // When next() has more to tell if the crowd does not change: as soon as may be, or at that time. Nothing: not before it changes.
  std::optional<Timer::Time> due(const Crowd& crowd) const;

 private:
  struct Told {
    std::uint64_t camera = 0, version = 0;
  };
  std::vector<Told>::iterator find(std::uint64_t camera);
  bool knows(std::uint64_t camera);
  // It has left and come again: the first is told in one message, the second in the next.
  bool waits(const Crowd::Participant& who) const { return std::ranges::find(left_, who.member().camera) != left_.end(); }
  // Appends what of it is new.
  void tell(const Crowd::Participant& who, std::string& out);
  void beginPass(const Crowd& crowd, const Crowd::Participant& self, const Terms& terms, std::string& out);
  void goOn(const Crowd& crowd, std::size_t bytes, std::string& out);

  bool wantsEverybody_ = true, states_ = true;
  std::size_t near_ = kNear;
  std::vector<Told> told_;           // by camera
  std::vector<std::uint64_t> left_;  // still to be told
  std::uint64_t version_ = 0;        // of the crowd at the last message; 0: there was none
  std::uint64_t last_ = 0;           // that was looked at, with Terms::all
  bool isCut_ = false;               // the last message told not all
  std::size_t others_ = 0;           // as told
  std::uint64_t counts_ = 0;         // CrowdPart::number that was told; 0: none, or one without cells
  struct {
    std::vector<std::uint64_t> cameras;
    std::size_t next = 0;
    std::uint64_t version = 0;  // of the crowd when it began
    Timer::Time began{};
  } pass_;
};

}  // namespace ridgecast::presence
