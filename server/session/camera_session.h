#pragma once
// One camera in a session: what arrives from its client goes in, iterations go out.
//
//                 hello                      error, or the client is gone
//   expects hello ------> runs ------------------------------------------> closed
//
// An actor: receive() and close() come from any thread, never block on an iteration and only note what happened; the work runs as a
// task of the camera's own pool, at most one at a time, one iteration a task, so that many cameras take turns.
//
// Free pacing: the newest pose wins; iterations go on while the client has room and a newer pose came or the mesh is not at rest. The
// first iteration for a pose is always sent; later ones only when they carry something, and that the mesh is at rest is told once.
// Lock-step: exactly one iteration for each pose, in order; at most kMaxQueuedPoses wait.
//
// A client that resumes names the leaves it still holds between hello and its first pose; only what differs is sent. The mesh begins anew here, coarse:
// in free pacing, without a budget of bytes, a client that holds at least half of its leaves keeps what it has until the mesh is at rest or was
// iterated kMostUnsent times, instead of losing its detail and getting it again.
//
// The client has room when fewer than `window` iterations are unacknowledged and less than maxQueuedBytes wait in its way out. All that
// waits there for long belongs to unacknowledged iterations, so an acknowledgement is the only event that can make room. With a budget of bytes a
// second an iteration also waits until those before it are paid for (pace.h); an alarm ends that.

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>

#include "common/wire/messages.h"
#include "server/replica/bases.h"
#include "server/replica/replica.h"
#include "server/session/grounds.h"
#include "server/session/pace.h"
#include "server/session/sender.h"
#include "server/session/session.h"

namespace ridgecast::session {

// Queries are answered by tasks of their own beside the iterations; at most wire::kMaxQueries are open at a time.
class CameraSession : public std::enable_shared_from_this<CameraSession> {
 public:
  CameraSession(std::shared_ptr<Session> session, Place place, std::uint64_t id, std::shared_ptr<Sender> sender);

  void receive(wire::ClientMessage message);
  // The client is gone: nothing more is sent, the mesh is freed by a task of the pool.
  void close();

  // Copies the mesh between two iterations, a few milliseconds at a time so that other cameras have their turns, and hands it over on a
  // thread of the pool; nullptr when the camera closes before that. False: there was no iteration yet, or kMaxHolds wait already.
  bool hold(Hold done);
  static constexpr std::size_t kMaxHolds = 16;
  static constexpr int kMostUnsent = 16;  // a mesh without a budget that binds rests after 10 to 20

  std::uint64_t id() const { return id_; }

 private:
  enum class Stage { kExpectsHello, kRuns, kClosed };
  using Refusal = std::optional<wire::ErrorMessage>;

  // Under the lock.
  Refusal take(wire::Hello& hello);
  Refusal take(wire::PoseMessage& pose);
  Refusal take(const wire::Acknowledge& acknowledge);
  Refusal take(const wire::ResendLeaves& resend);
  Refusal take(const wire::Resume& resume);
  Refusal take(const wire::AskClock& ask);
  Refusal take(const wire::SetClock& set);
  Refusal take(const wire::Step& step);
  Refusal take(const wire::StepDone& done);
  Refusal take(wire::Query& query);
  Refusal take(const wire::AskGround& ask);
  Refusal expectsWorld(std::string_view what) const;
  Refusal take(const wire::WantTiles& wanted);
  Refusal take(const wire::ChangeSettings& change);
  bool hasWork() const;
  bool wake();  // false: the pool takes no more

  void refuse(wire::ErrorMessage message);
  void run();
  void work();
  void iterate();
  wire::Settings granted(const wire::Settings& asked) const;
  void countTriangles(std::uint32_t now);
  void copy();
  void sendTiles();
  void encode(const replica::Changes& changes, wire::Iteration& iteration);

  const std::shared_ptr<Session> session_;
  const Place place_;
  const std::uint64_t id_;
  const std::shared_ptr<Sender> sender_;
  const std::shared_ptr<scheduling::Pool> pool_;

  mutable std::mutex mutex_;
  Stage stage_ = Stage::kExpectsHello;
  bool scheduled_ = false;  // a task is queued or runs
  bool greeted_ = false;    // the world was sent
  bool lockstep_ = false;
  wire::Hello hello_;
  wire::Settings granted_;  // written by the running task
  struct Change {
    std::uint64_t after = 0;  // lock-step: for poses with a greater sequence
    wire::Settings granted;
  };
  std::deque<Change> changes_;  // free: at most one, the newest; lock-step: at most kMaxQueuedPoses
  std::uint64_t lastSequence_ = 0;
  std::deque<wire::PoseMessage> poses_;     // free: at most one, the newest
  std::deque<terrain::TileAddress> tiles_;  // wanted, at most wire::kMaxWantedTiles; sent before the next iteration
  bool atRest_ = true;                      // nothing to do before another pose
  replica::Replica replica_;
  Pace pace_;
  bool alarmSet_ = false;
  std::vector<Hold> holds_;
  std::uint64_t sentNumber_ = 0, sentHash_ = 0;  // of the last iteration
  int unsent_ = 0;                               // iterations before the first that was sent to a client that resumes
  std::shared_ptr<std::atomic<std::size_t>> queries_ = std::make_shared<std::atomic<std::size_t>>(0);  // not answered, or not sent yet
  std::shared_ptr<Grounds> grounds_;                                                                   // once one was asked for

  // Of the running task alone.
  std::unique_ptr<IteratingMesh> mesh_;
  replica::Bases bases_;
  wire::PoseMessage pose_;     // of the last iteration
  std::uint32_t counted_ = 0;  // triangles, in the figures
  bool posed_ = false;         // there was one; written under the lock
  double effectiveThreshold_ = 0;
  std::shared_ptr<HeldMesh> copy_;
};

}  // namespace ridgecast::session
