#pragma once
// A client's half of the conversation with a server (other half: server/conversation): what is sent and in which order, what was received,
// and whether that is valid. A state machine without socket, thread and clock: frames and times come in, frames go out. Not thread-safe.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/core/conversation/asked_ground.h"
#include "client/core/conversation/outbox.h"
#include "client/core/conversation/roster.h"
#include "client/core/conversation/session_clock.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

struct Received {
  wire::Iteration iteration;
  std::uint64_t bytes = 0;  // of the frame
};
struct EditsMade {
  std::uint64_t after = 0;  // `made` begins after this edit; whatever is held of later ones is void: a recording has gone back
  std::uint64_t there = 0;  // the world's last edit when the conversation began
  std::vector<wire::MadeEdit> made;
};

class Conversation {
 public:
  using Instant = SessionClock::Instant;

  // `server`: its name in messages.
  Conversation(wire::Hello hello, std::string server);

  // ---- the line: one frame at a time each way ----

  std::string hello() const;  // the first frame
  // A returned sentence ends the conversation: the server's farewell, or what is wrong with the frame.
  Wrong heard(std::span<const std::uint8_t> frame, Instant now);
  // The most urgent frame, when the one before has left; nothing when none may leave now.
  std::optional<std::string> next(Instant now);
  // When next() has a frame although nothing was said or heard.
  std::optional<Instant> due() const { return asksClock_; }
  void end(const Error& why);  // fails all unanswered requests, and later ones

  // ---- what is said: a returned sentence ends the conversation; no effect before the world arrives ----

  // A waiting pose is replaced by a newer one (free pacing) or queued (lock-step, at most kMaxPoses).
  Wrong send(const wire::PoseMessage& pose) { return outbox_.put(pose); }
  Wrong acknowledge(const wire::Acknowledge& acknowledge);  // replaces an earlier one
  Wrong resume(const wire::Resume& resume);                 // before the first pose
  Wrong resend(const wire::ResendLeaves& resend);           // added to those queued
  Wrong change(const wire::Settings& settings);             // replaces an earlier one
  Wrong want(const wire::WantTiles& wanted) { return request(wanted, 0); }
  Wrong want(const wire::WantSquares& wanted) { return request(wanted, 5); }
  Wrong find(const wire::FindEdits& find) { return request(find, 5); }
  Wrong setClock(const wire::SetClock& set);
  Wrong step(const wire::ClockStep& step) { return outbox_.put(step); }
  Wrong stepDone(const wire::StepDone& done) { return outbox_.put(done); }
  Wrong skipSteps(bool skips);  // from now on, steps are answered as done on receipt
  Wrong passOver(std::uint64_t camera);

  // Requests; each sets the id. `done` is called once: in heard(), in end(), or at once if the queue is full or the server's revision lacks
  // the request.
  void ask(wire::Query query, std::function<void(Outcome<wire::Answer>)> done);
  void ask(const wire::AskGround& ask, std::function<void(Outcome<wire::Ground>)> done);
  void ask(wire::Edit edit, std::function<void(Outcome<wire::EditAnswer>)> done);

  // ---- what was heard ----

  bool hasWorld() const { return hasWorld_; }
  const wire::World& world() const { return world_; }
  const wire::Settings& granted() const { return granted_; }
  const Roster& roster() const { return roster_; }
  const SessionClock& clock() const { return clock_; }
  bool speaksOther() const { return speaksOther_; }                     // another protocol version: reconnecting is pointless
  const std::optional<std::string>& sentTo() const { return sentTo_; }  // where to reconnect, from its farewell; empty: the same place
  bool isRecording() const { return clock_.said().end > 0; }            // as far as the clock was heard
  bool followsEdits() const { return hello_.edits || world_.revision < 4; }
  std::uint64_t bytes() const { return bytes_; }
  bool hasIterations() const { return !iterations_.empty(); }
  // The next iteration, in order. At most the world's window of them wait, and 256 MiB.
  std::optional<Received> receive();
  static constexpr std::size_t kMaxMadeEdits = 1u << 20;  // queued; one more is an error
  EditsMade takeEdits();
  std::uint64_t told() const { return lastEdit_; }  // the last edit of takeEdits(), taken or not
  std::uint64_t forgetEdits();                      // drops those queued; returns the number of the last before them
  std::uint64_t edit() const { return edit_; }      // the newest that the server has spoken of
  std::vector<wire::HeightTile> takeTiles() { return ground_.takeTiles(); }
  EditsFound takeEditsFound() { return ground_.takeEdits(); }
  bool hasGround() const { return ground_.hasCome(); }  // to be taken by these two

 private:
  struct Frame {
    std::uint64_t bytes;
    Instant heard;
  };
  Wrong take(wire::ServerMessage& message, const Frame&);
  template <class Other>
  Wrong take(Other&&, const Frame&) {  // taken before
    return {};
  }
  Wrong take(wire::World&& world, const Frame&);
  Wrong take(wire::Iteration&& iteration, const Frame&);
  Wrong take(wire::HeightTiles&& come, const Frame&) { return ground_.hear(std::move(come)); }
  Wrong take(wire::Squares&& come, const Frame&) { return ground_.hear(std::move(come)); }
  Wrong take(wire::FoundEdits&& come, const Frame&) { return ground_.hear(std::move(come)); }
  Wrong take(wire::Members&& members, const Frame&);
  Wrong take(wire::Clock&& said, const Frame&);
  Wrong take(wire::Edited&& edited, const Frame&);
  Wrong take(wire::Granted&& granted, const Frame&);
  Wrong take(wire::Answer&& answer, const Frame&);
  Wrong take(wire::Ground&& ground, const Frame&);
  Wrong take(wire::EditAnswer&& answer, const Frame&);
  template <class Wanted>
  Wrong request(const Wanted& wanted, std::uint32_t revision) {
    if (world_.revision < revision) return std::nullopt;
    ground_.asks(wanted);
    return outbox_.put(wanted), std::nullopt;
  }
  Wrong skipStep();
  Error lacks(const char* what) const;

  const wire::Hello hello_;
  const std::string server_;
  Outbox outbox_;
  bool hasWorld_ = false, skipsSteps_ = false, speaksOther_ = false;
  wire::World world_;
  wire::Settings granted_;
  std::optional<std::string> sentTo_;
  std::deque<Received> iterations_;
  std::uint64_t waitingBytes_ = 0;  // of their frames
  AskedGround ground_;
  std::uint64_t lastEdit_ = 0, edit_ = 0;
  std::vector<wire::MadeEdit> edits_;
  Roster roster_;
  SessionClock clock_;
  std::optional<Instant> asksClock_;  // next
  int clockAsked_ = 0;                // times
  std::uint64_t bytes_ = 0;
};

}  // namespace ridgecast::core
