#pragma once
// A member of a simulated session, honest: the client's own conversations and replica, without sockets and threads. It flies, asks, steps
// the clock when it has it, is slow, loses its line and comes back. What it sees is judged as it comes.

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>

#include "client/core/conversation/reconnector.h"
#include "client/core/mesh/follower.h"
#include "tests/simulation/cluster.h"
#include "tests/simulation/editor.h"
#include "tests/simulation/line.h"
#include "tests/simulation/poster.h"
#include "tests/simulation/server.h"
#include "tests/simulation/truth.h"

namespace ridgecast::simulation {

class Member {
 public:
  struct Nature {
    wire::Hello hello;
    Line::Way way;
    Duration think{};            // about each iteration, before its acknowledgement
    Duration leaving{};          // of each frame that it sends: the next one waits so long
    std::size_t stateBytes = 0;  // of its own in each pose
    std::string session{directory::kDefaultName};
  };

  // Begins around a place. All must outlive it.
  Member(std::string name, Cluster& cluster, Truth& truth, SimulatedTimer& timer, Random& random, const Nature& nature,
         lattice::Point near);
  ~Member() { leave({}); }

  // What it may do; nothing where it cannot.
  void join();                   // with nothing
  void lose(Duration unheard);   // the line; it comes back
  void mute(Duration noticed);   // the line is dead, and nobody knows
  void fall(const Server& of);   // it will notice, if it is at this one
  void leave(Duration unheard);  // for good; what it holds can still be judged
  void fly(double metres);
  void insist();  // in lock-step: the same pose again, once the last one was answered
  void ask(bool much = false);
  void askGround();
  void askMap();  // over HTTP, for a tile of heights that knows all edits of which anybody knows
  void takeClock();
  void step();
  void setThreshold(double pixels);
  void edit();                    // the ground before it
  void post();                    // the same over HTTP, connected or not
  void stall(Duration time);      // it reads nothing
  void undo(std::uint64_t edit);  // until its answer has come

  bool connected() const { return client_ && !client_->lost() && conversation().hasWorld(); }
  bool isAway() const { return !client_; }
  const Server& server() const { return *server_; }  // of its last line
  const std::string& session() const { return nature_.session; }
  bool isLockstep() const { return nature_.hello.pacing == wire::Pacing::kLockstep; }
  bool mayAsk() const { return connected() && !editor_.waits(); }
  bool wasRefused() const { return editor_.wasRefused(); }
  // Everything it has been told is taken, every question answered, and the mesh is at rest at its last pose on the ground of this edit.
  bool rests(std::uint64_t edit) const;
  bool knows(const presence::Presence::State& state) const;  // the others and the clock, as far as it wants to
  void judge(const terrain::Terrain& ground) const;          // its mesh: every vertex lies on this
  void judgeWait() const;                                    // the server owes it nothing, once all has arrived
  std::string state() const;                                 // for a person
  std::uint64_t history() const { return history_; }         // a hash of what it has seen

 private:
  core::Conversation& conversation() { return client_->conversation(); }
  const core::Conversation& conversation() const { return client_->conversation(); }
  const wire::World& world() const { return conversation().world(); }
  void open();
  void ended();
  void forget();  // its client
  void hear(const std::string& frame);
  void flush();                                      // what may leave now
  void later(Time when, std::function<void()> act);  // while this line lasts, or none
  void say(const core::Wrong& wrong);
  void look();                                      // at what has come
  void begin(std::uint64_t lastPose, bool isNext);  // after another conversation
  void take(const wire::Iteration& iteration);
  bool digests() const { return thinks_ || conversation().hasIterations(); }
  void lookAtMembers();
  void take(const wire::Clock& clock);
  bool isBehind(const std::string& wrong) const;
  void judgeClock(const wire::Clock& clock);
  void judgeIteration(const wire::Iteration& iteration, bool isNewGround);
  void digest(const wire::Iteration& iteration);
  void pose();
  void chooseSite();
  void saw(std::uint64_t what) { history_ = lattice::mix(history_ + what); }

  const std::string name_;
  Cluster& cluster_;
  Server* server_;
  Truth& truth_;
  SimulatedTimer& timer_;
  Random& random_;
  const Nature nature_;
  const Editor::Say say_ = [this](wire::Edit edit, Editor::Answered done) {
    conversation().ask(std::move(edit), [this, done = std::move(done)](const Outcome<wire::EditAnswer>& answer) {
      done(answer);
      if (answer) saw(answer->number);
    });
    flush();
  };

  Editor editor_;
  Poster poster_;
  lattice::Point site_;  // what it edits
  core::Follower follower_;
  camera::Camera camera_;
  double heading_ = 0, threshold_ = 0;
  std::uint64_t sequence_ = 0, history_ = 0;
  bool thinks_ = false;  // about an iteration

  std::optional<core::Reconnector> client_;  // nothing: it is away
  std::shared_ptr<Line> line_;
  std::uint64_t lines_ = 0;    // begun and ended
  std::uint64_t lives_ = 0;    // ended
  bool leaving_ = false;       // a frame is
  std::optional<Time> wakes_;  // flush() will be called

  // Of the conversation.
  bool begun_ = false;  // its world is there
  wire::Clock said_;    // about the time, before
  std::uint64_t lastNumber_ = 0, lastPose_ = 0, lastStepDone_ = 0, stepAsked_ = 0, edit_ = 0;
  std::uint64_t membersSeen_ = 0, clockSeen_ = 0;  // versions
  std::uint64_t stepSeen_ = 0, timeSeen_ = 0;      // of the clock, by any server in touch with the others
  std::uint64_t endings_ = 0;                      // of its session before
  Time opened_{};                                  // the line was
  bool isNew_ = false;                             // no iteration of this conversation was judged
  std::size_t questions_ = 0, grounds_ = 0;        // that have no answer
  bool settled_ = false;
};

}  // namespace ridgecast::simulation
