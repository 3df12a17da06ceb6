#pragma once
// The server's half of the protocol as a pure state machine: what a client may send when, and what the server does for it next.
//
//                 hello                 world sent            error, or the client is gone
//   expects hello -----> expects world ----------> runs -------------------------------------> closed
//
// receive() takes a message in. due() says when there is work and next() takes it out. The caller reports its result by greeted(),
// iterated() and sent(). No lock, thread, clock or socket: the time, and the bytes queued for the client, are arguments. The same calls
// give the same results, except that they may wait for repairs on the client's other connections (Terms::repairs).
//
// Free pacing: the newest pose wins. Iterations continue while the client has room and the pose is new or the mesh is not at rest. The
// first iteration for a pose is always sent, later ones only if they change something; that the mesh is at rest is sent once.
// New ground comes first, in one more iteration at the last pose: a new pose may take ten times as long.
// Lock-step: exactly one iteration for each pose, in order.
//
// A reconnecting client lists the leaves it still holds between hello and its first pose; only differences are sent. The server's mesh
// starts coarse. The server may first run up to kMaxUnsent iterations without sending them, so that the client keeps its detail: in free
// pacing, without a budget of bytes, if the client holds at least half of its leaves. With a checkpoint of the mesh that the client holds,
// none of this is needed: the caller may look for one meanwhile.
//
// The client has room if fewer than `window` iterations are unacknowledged and at most maxQueuedBytes are queued for it. With a budget of
// bytes a second, an iteration also waits until those before it are paid for (rate.h).

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <variant>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/terrain/raster.h"
#include "common/wire/messages.h"
#include "server/conversation/rate.h"
#include "server/replica/replica.h"

namespace ridgecast::conversation {

inline constexpr std::size_t kMaxQueuedPoses = 64;  // lock-step: poses, and changes of settings, waiting for their iteration
inline constexpr int kMaxUnsent = 16;               // a mesh without a binding budget is at rest after 10 to 20 iterations
inline constexpr std::size_t kTilesAtOnce = 16, kSquaresAtOnce = 4;
inline constexpr std::uint32_t kMaxForGround = 512;  // vertices that an iteration for new ground inserts
// After n bytes of leaves that were requested again, no other such leaf is sent for n / kRepairBytesPerSecond.
inline constexpr std::uint64_t kRepairBytesPerSecond = 1u << 20;

// What the server grants each client.
struct Terms {
  std::function<wire::Settings(const wire::Settings& requested)> grant;
  std::uint32_t window = replica::kDefaultWindow;
  std::size_t maxQueuedBytes = 8u << 20;
  std::optional<terrain::RasterShape> heightMap;  // its tiles may be requested
  // Of leaves sent again, on all connections of this client.
  std::shared_ptr<SharedBudget> repairs = std::make_shared<SharedBudget>(kRepairBytesPerSecond);
  bool sendsEdits = true;  // the posts of edited ground may be requested
};

// What to do next.
struct Greet {};  // send the world, then call greeted()
struct SendTiles {
  std::vector<terrain::TileAddress> tiles;
};
struct SendSquares {
  std::vector<terrain::TileAddress> squares;
};
struct Iterate {
  wire::PoseMessage pose;
  std::optional<wire::Settings> granted;    // apply from this iteration on; tell the client first
  std::optional<std::uint32_t> insertions;  // at most, from this iteration on
  bool isHurried = false;                   // it may insert fewer vertices so that iterations keep pace with poses
};
using Work = std::variant<std::monostate, Greet, SendTiles, wire::FindEdits, SendSquares, Iterate>;

// Not thread-safe.
class Conversation {
 public:
  using Time = ByteRate::Clock::time_point;
  using Refusal = std::optional<wire::ErrorMessage>;

  explicit Conversation(Terms terms);

  // Refused: the connection must end with this error. Queries, and messages about other members, are only checked for their place in the
  // protocol; the caller answers them.
  Refusal receive(const wire::ClientMessage& message, Time now);
  void close();

  // When next() has work. Nothing: not before another event. A past time: now.
  std::optional<Time> due(std::size_t queuedBytes) const;
  Work next(std::size_t queuedBytes);

  void greeted();
  // The mesh has new ground from its next iteration on. Free pacing: that iteration always runs and is sent.
  void groundChanged();
  // No iteration while a checkpoint of the mesh that the client resumes is looked for, or once the mesh is handed over.
  void awaitCheckpoint(bool waits) { awaitsCheckpoint_ = waits; }
  bool awaitsCheckpoint() const { return awaitsCheckpoint_; }
  void leave() { leaves_ = true; }
  // After the first Iterate, in place of an iteration: the mesh is what the client holds. iterated() comes next.
  void restored(std::span<const mesh::LeafState> leaves);
  // Free pacing, while it runs: what was requested last is granted again, as the terms are now, as if the client had requested it again.
  void grantAgain();
  // After Iterate: what to send of the current mesh, or nothing. `leaves` in canonical order.
  std::optional<replica::Changes> iterated(std::span<const mesh::LeafState> leaves, bool settled);
  void sent(const wire::Iteration& iteration, Time now);
  void sent(const wire::HeightTiles& tiles, Time now);
  void sent(std::size_t bytes, Time now) { byteRate_.sent(now, bytes, 0); }  // of other messages

  bool runs() const { return stage_ == Stage::kRuns; }
  bool closed() const { return stage_ == Stage::kClosed; }
  const wire::Hello& hello() const { return hello_; }
  const wire::Settings& granted() const { return granted_; }      // as of the last iteration
  const wire::Settings& requested() const { return requested_; }  // last
  // As of the next iteration.
  const wire::Settings& newestGrant() const { return changes_.empty() ? granted_ : changes_.back().granted; }
  bool isLockstep() const { return lockstep(); }
  const wire::PoseMessage& pose() const { return pose_; }  // of the last iteration
  std::optional<wire::PoseMessage> newestPose() const { return poses_.empty() ? std::nullopt : std::optional(poses_.back()); }
  bool isLate() const { return !lockstep() && !poses_.empty(); }  // a newer pose than the last iteration's has come
  std::uint64_t mismatches() const { return mismatches_; }        // acknowledgements of another mesh than the one sent
  const replica::Replica& replica() const { return replica_; }

 private:
  enum class Stage { kExpectsHello, kExpectsWorld, kRuns, kClosed };
  struct Change {
    std::uint64_t after = 0;  // lock-step: for poses with a greater sequence
    wire::Settings granted;
  };

  Refusal take(const wire::Hello& hello);
  Refusal take(const wire::PoseMessage& pose, Time now);
  Refusal take(const wire::Acknowledge& acknowledge);
  Refusal take(const wire::ResendLeaves& resend) {
    replica_.resend(resend.leaves);
    return {};
  }
  Refusal take(const wire::Resume& resume);
  Refusal take(const wire::WantTiles& request);
  Refusal take(const wire::FindEdits& find);
  Refusal take(const wire::WantSquares& request);
  Refusal take(const wire::ChangeSettings& change);
  Refusal take(const auto&) { return {}; }
  Refusal outOfPlace(const wire::ClientMessage& message) const;
  bool lockstep() const { return hello_.pacing == wire::Pacing::kLockstep && !hello_.placesOnly; }
  bool hasWork(std::size_t queuedBytes) const;
  bool hasIteration() const;
  bool hasEdits() const { return !finds_.empty() || !squares_.empty(); }

  const Terms terms_;
  Stage stage_ = Stage::kExpectsHello;
  wire::Hello hello_;
  wire::Settings requested_, granted_;
  std::uint64_t lastSequence_ = 0;
  std::deque<wire::PoseMessage> poses_;       // lock-step: at most kMaxQueuedPoses; free: at most one, the newest
  std::deque<Change> changes_;                // as poses_
  std::deque<terrain::TileAddress> tiles_;    // requested, at most wire::kMaxWantedTiles; sent before the next iteration
  std::deque<wire::FindEdits> finds_;         // at most wire::kMaxFinds; answered in turn with iterations
  std::deque<terrain::TileAddress> squares_;  // at most wire::kMaxWantedSquares; the same
  bool editsWait_ = false;                    // the last work was theirs
  wire::PoseMessage pose_;                    // sequence 0: none yet
  bool atRest_ = true;                        // nothing to do before another pose
  bool groundIsNew_ = false;                  // since the last iteration
  bool awaitsCheckpoint_ = false, leaves_ = false;
  int unsent_ = 0;  // iterations before the first one sent to a reconnecting client
  std::uint64_t mismatches_ = 0;
  replica::Replica replica_;
  ByteRate byteRate_;
  InsertionRate insertionRate_;  // free pacing alone: lock-step repeats
  struct {
    bool owesAnswer = false;   // is sent even if it changes nothing
    bool isForGround = false;  // poses wait, but for one iteration only
    bool repairs = false;      // sends leaves again
  } current_;                  // iteration
};

}  // namespace ridgecast::conversation
