#pragma once
// A connection to a server's stream that reconnects when it ends: conversations (core::Reconnector) over a WebSocket, which runs on its own
// thread; the owner's thread sends and receives. Until receive() switches to the next conversation, the ended one stays: it sends nothing,
// and its requests fail.

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "client/core/conversation/reconnector.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::link {

// How to wait for the answer to the upgrade if the URL names a terrain: the server may have to compile it first, which takes seconds, and a
// minute on a slow machine.
struct Waiting {
  std::chrono::milliseconds unheard{90'000};  // timeout without any progress
  // Timeout since the last progress: the server reports it about every second; and of the first line with a server that refuses for a while
  // (503 with Retry-After), which is dialled again.
  std::chrono::milliseconds heard{30'000};
  std::function<void()> preparing = {};  // called at each progress, on the network's thread
  std::stop_token stop = {};             // gives up, at any time before the world is there: an error
};

struct Options {
  bool reconnects = true;                     // false: the first loss is the end
  std::chrono::milliseconds timeout{10'000};  // of the first line, which must succeed
  Waiting waiting = {};                       // for the first line
};

class Connection {
 public:
  // Called in receive() when the server is back; returns the leaves held. Must not call the connection.
  using Resume = std::function<std::vector<wire::Resume>(const wire::World& coming)>;

  // Connects, says hello, and returns when the world has arrived. Errors: nothing listens there, no answer within the timeout (of a server
  // that may have to make the world, see Waiting), not a Ridgecast server, refused by the server (its own message). Each says what to try.
  // Looking up a host name may take as long as the system's resolver does.
  static Outcome<std::unique_ptr<Connection>> open(const core::Url& url, const wire::Hello& hello, const Options& options = {},
                                                   Resume resume = {});
  ~Connection();  // closes politely, waits at most 200 ms for it
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  const wire::World& world() const;  // good until receive() is called

  // Never block, and do nothing while the connection is lost. Later conversations begin with the newest pose. A waiting pose is replaced by
  // a newer one (free pacing) or queued (lock-step, at most core::kMaxPoses: one more ends the connection with an error). A waiting
  // acknowledgement is replaced by a newer one. Leaves to be resent are collected up to one message's worth; more request all.
  void send(const wire::PoseMessage& pose);
  void acknowledge(const wire::Acknowledge& acknowledge);
  // Before the first pose: leaves that are held (parts of at most wire::kMaxResumeLeaves).
  void resume(const wire::Resume& resume);
  void resend(const wire::ResendLeaves& resend);

  // Tiles of the world's height map; at most wire::kMaxWantedTiles unanswered, and one message's worth a call.
  void want(const wire::WantTiles& wanted);
  // Those that have come since the last call.
  std::vector<wire::HeightTile> takeTiles();

  // Squares of edited posts, like tiles above: at most wire::kMaxWantedSquares unanswered; and searches for them: at most wire::kMaxFinds.
  // Sent only to a server that knows them (World::revision 5).
  void want(const wire::WantSquares& wanted);
  void find(const wire::FindEdits& find);
  core::EditsFound takeEditsFound();

  // The next iteration, in order; nothing if none arrived within `timeout` (0: do not wait), or if the connection has ended for good and
  // everything received is taken: then error() says why. The queue holds at most the world's window of iterations and 256 MiB; a server
  // that sends more is disconnected. A lost connection reconnects once this is called.
  std::optional<core::Received> receive(std::chrono::milliseconds timeout);
  // With hello.members: the other members, as last heard; nothing, without a copy, while `version`, which grows with everything heard, is
  // still `seen`.
  std::optional<core::Roster> others(std::uint64_t seen = 0) const;

  // With hello.clock: the session's clock, requested repeatedly so that it stays good to a fraction of a round trip.
  core::SessionClock clock() const;
  // Waits until something newer than `seen` (core::SessionClock::version) was heard; false: nothing was within `timeout`, or the connection
  // has ended.
  bool waitForClock(std::uint64_t seen, std::chrono::milliseconds timeout) const;
  // Never block. At most core::kMaxWaiting of these wait to leave: one more ends the connection with an error.
  void setClock(const wire::SetClock& set);
  void step(const wire::ClockStep& step);
  void stepDone(const wire::StepDone& done);
  // Whether steps are answered as done on receipt, for a member that does not follow the clock; initially off.
  void skipSteps(bool skips);
  // Of the clock's owner: steps no longer wait for this member. Does nothing if the server's version cannot (World::revision below 3).
  void passOver(std::uint64_t camera);

  // Requests to the server; sets `id`. The future holds the answer, or an error if the connection ends, the server knows no queries
  // (World::revision 0), or more than core::kMaxWaiting wait. At most wire::kMaxQueries and wire::kMaxGrounds are pending at a time; the
  // others wait here. Futures may outlive the connection.
  std::future<Outcome<wire::Answer>> ask(wire::Query query);
  std::future<Outcome<wire::Ground>> askGround(const wire::AskGround& ask);

  // Changes the ground; sets `id`. The future holds the edit's number once it is made, kept and in everybody's ground, or an error; at most
  // wire::kMaxEdits are pending at a time. With hello.edits: the edits made since the last call, in order.
  std::future<Outcome<wire::EditAnswer>> edit(wire::Edit edit);
  core::EditsMade takeEdits();
  bool followsEdits() const;  // hello.edits, or the server's version has none

  // Replaces hello's settings from the next iteration on. A waiting change is replaced by a newer one and leaves before waiting poses.
  // Never blocks; does nothing if the server's version changes none (World::revision below 2).
  void change(const wire::Settings& settings);
  wire::Settings granted() const;  // the settings the server iterates by, as last heard

  // Any thread: waits until this holds of what was heard, at most `timeout`; whether it does. It must not call the connection.
  bool wait(std::chrono::milliseconds timeout, const std::function<bool(const core::Reconnector&)>& holds) const;

  std::optional<Error> error() const;  // why there is no connection at the moment
  // Where a leaving server has sent us; empty: the same place.
  std::optional<std::string> sentTo() const;
  bool otherWorld() const;  // core::Reconnector::otherWorld()
  bool comesBack() const;   // if lost: another attempt is made
  std::uint64_t reconnections() const;
  std::uint64_t bytesReceived() const;

 private:
  struct Impl;
  explicit Connection(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace ridgecast::link
