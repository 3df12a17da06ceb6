#pragma once
// What one client may say when, and what the server does for it next: the server's half of the protocol as a pure state machine.
//
//                 hello                 world sent            error, or the client is gone
//   expects hello -----> expects world ----------> runs -------------------------------------> closed
//
// receive() takes a message in. due() says when there is work and next() takes it out; its result is reported by greeted(), iterated() and
// sent(). There is no lock, thread, clock or socket in here: the time, and the bytes that wait in the client's way out, are arguments. The same
// calls give the same answers.
//
// Free pacing: the newest pose wins; iterations go on while the client has room and a newer pose came or the mesh is not at rest. The first
// iteration for a pose is always sent, later ones only when they carry something, and that the mesh is at rest is said once.
// Lock-step: exactly one iteration for each pose, in order.
//
// A client that resumes names the leaves it still holds between hello and its first pose; only what differs is sent. The mesh starts again from
// nothing, coarse: in free pacing, without a budget of bytes, a client that holds at least half of its leaves keeps its detail until the mesh
// is at rest or was iterated kMostUnsent times.
//
// The client has room when fewer than `window` iterations are unacknowledged and at most maxQueuedBytes wait in its way out. All that waits
// there for long belongs to unacknowledged iterations, so only an acknowledgement can make room. With a budget of bytes a second an iteration
// also waits until those before it are paid for (pace.h).

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "common/mesh/leaf_state.h"
#include "common/terrain/raster.h"
#include "common/wire/messages.h"
#include "server/conversation/pace.h"
#include "server/replica/replica.h"

namespace ridgecast::conversation {

inline constexpr std::size_t kMaxQueuedPoses = 64;  // lock-step: poses, and changes of settings, that wait for their iteration
inline constexpr int kMostUnsent = 16;              // a mesh without a budget that binds rests after 10 to 20 iterations
inline constexpr std::size_t kTilesAtOnce = 16;

// What the server grants each client.
struct Terms {
  std::function<wire::Settings(const wire::Settings& requested)> grant;
  std::uint32_t window = replica::kDefaultWindow;
  std::size_t maxQueuedBytes = 8u << 20;
  std::optional<terrain::RasterShape> heightMap;  // whose tiles a client may have
};

// What to do next.
struct Greet {};  // send the world, then call greeted()
struct SendTiles {
  std::vector<terrain::TileAddress> tiles;
};
struct Iterate {
  wire::PoseMessage pose;
  std::optional<wire::Settings> granted;    // apply from this iteration on; tell the client first
  std::optional<std::uint32_t> insertions;  // at most, from this iteration on
};
using Work = std::variant<std::monostate, Greet, SendTiles, Iterate>;

// Not thread-safe.
class Conversation {
 public:
  using Time = Pace::Clock::time_point;
  using Refusal = std::optional<wire::ErrorMessage>;

  explicit Conversation(Terms terms) : terms_(std::move(terms)), replica_(terms_.window) {}

  // Refused: the connection must end with this error. Queries and what concerns other members is only checked to be in place; answering it is up
  // to the caller.
  Refusal receive(const wire::ClientMessage& message);
  void close();

  // When next() has work: nothing means not before something else happens, a time that has passed means now.
  std::optional<Time> due(std::size_t queuedBytes) const;
  Work next(std::size_t queuedBytes);

  void greeted();
  // After Iterate: what to send of the mesh as it is now, or nothing. `leaves` in canonical order.
  std::optional<replica::Changes> iterated(std::span<const mesh::LeafState> leaves, bool settled);
  void sent(const wire::Iteration& iteration, Time now);
  void sent(const wire::HeightTiles& tiles, Time now);

  bool runs() const { return stage_ == Stage::kRuns; }
  bool closed() const { return stage_ == Stage::kClosed; }
  const wire::Hello& hello() const { return hello_; }
  const wire::Settings& granted() const { return granted_; }  // as of the last iteration
  const wire::PoseMessage& pose() const { return pose_; }     // of the last iteration
  std::optional<wire::PoseMessage> newestPose() const { return poses_.empty() ? std::nullopt : std::optional(poses_.back()); }
  const replica::Replica& replica() const { return replica_; }

 private:
  enum class Stage { kExpectsHello, kExpectsWorld, kRuns, kClosed };
  struct Change {
    std::uint64_t after = 0;  // lock-step: for poses with a greater sequence
    wire::Settings granted;
  };

  Refusal take(const wire::Hello& hello);
  Refusal take(const wire::PoseMessage& pose);
  Refusal take(const wire::Acknowledge& acknowledge);
  Refusal take(const wire::ResendLeaves& resend);
  Refusal take(const wire::Resume& resume);
  Refusal take(const wire::WantTiles& request);
  Refusal take(const wire::ChangeSettings& change);
  Refusal take(const auto&) { return {}; }
  Refusal outOfPlace(const wire::ClientMessage& message) const;
  bool hasWork(std::size_t queuedBytes) const;

  const Terms terms_;
  Stage stage_ = Stage::kExpectsHello;
  wire::Hello hello_;
  wire::Settings granted_;
  bool lockstep_ = false;
  std::uint64_t lastSequence_ = 0;
  std::deque<wire::PoseMessage> poses_;     // lock-step: at most kMaxQueuedPoses; free: at most one, the newest
  std::deque<Change> changes_;              // as poses_
  std::deque<terrain::TileAddress> tiles_;  // requested, at most wire::kMaxWantedTiles; sent before the next iteration
  wire::PoseMessage pose_;                  // sequence 0: none yet
  bool owesAnswer_ = false;                 // the iteration under way is sent whatever it changes
  bool atRest_ = true;                      // nothing to do before another pose
  int unsent_ = 0;                          // iterations before the first that was sent to a client that resumes
  replica::Replica replica_;
  Pace pace_;
};

}  // namespace ridgecast::conversation
