#pragma once
// One camera in a session: ties its conversation (server/conversation) to its mesh, its encoder and its pool.
//
// An actor: receive() and close() may come from any thread, never wait for an iteration and only record what happened. The work runs as a
// task of the camera's own pool, at most one at a time and one iteration each, so that many cameras take turns. Actors of their own answer
// queries and grounds beside the iterations (queries.h, grounds.h).

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"
#include "server/conversation/conversation.h"
#include "server/conversation/sender.h"
#include "server/encoding/encoder.h"
#include "server/member/camera_figures.h"
#include "server/questions/grounds.h"
#include "server/questions/queries.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"

namespace ridgecast::member {

class CameraSession final : public session::LiveCamera, public std::enable_shared_from_this<CameraSession> {
 public:
  CameraSession(std::shared_ptr<session::Session> session, session::Membership membership, std::uint64_t id,
                std::shared_ptr<conversation::Sender> sender);

  void receive(wire::ClientMessage message);
  // The client is gone: sends nothing more; a task of the pool frees the mesh.
  void close();

  void groundChanged() override;

  // The server leaves: iterations end, and the mesh goes to the server that the client finds next. `done` is called once it may be sent
  // there, unless close() comes first. False: the mesh cannot go, and nothing changes. Where there is another server: free pacing, a client
  // that follows points, and a session that is not recorded, since a replay makes its meshes from poses alone.
  bool handOver(std::function<void()> done);

  // A few milliseconds at a time, so that other cameras get their turns; at most kMaxCopies requests wait.
  bool copy(session::TakeCopy done) override;
  void goAway() override;
  static constexpr std::size_t kMaxCopies = 16;

  // A client that resumes waits this long for an engine that does not answer; a checkpoint waits this long for its client.
  static constexpr std::chrono::milliseconds kCheckpointTimeout{2000};
  // A camera in free pacing that was granted fewer triangles than it requested looks this often for more. It takes them if there is room
  // twice in a row, so that clients that come back within seconds find what they had, and if they are all that it requested or twice what
  // it has: a mesh begins again for them.
  static constexpr std::chrono::seconds kSeeksRoom{10};

  // A client whose window has been full this long without an acknowledgement is sent away.
  static constexpr std::chrono::minutes kAcknowledgeTimeout{5};

  // Looks so often again while more is queued for a client than it may have for its next iteration.
  static constexpr std::chrono::milliseconds kQueueRetry{20};

  std::uint64_t id() const { return id_; }

 private:
  using Refusal = conversation::Conversation::Refusal;
  using IterationStats = settings::IterationStats;

  // Under the lock: messages that others answer.
  Refusal attend(const wire::ClockStep& step);
  Refusal attend(const wire::StepDone& done);
  Refusal attend(wire::Query& query);
  Refusal attend(const wire::AskGround& ask);
  Refusal attend(const wire::Edit& edit);
  Refusal attend(const wire::Resume& resume);
  Refusal attend(const auto& message) {
    if constexpr (requires { session_->presence().receive(id_, message); }) session_->presence().receive(id_, message);
    if constexpr (requires { session_->clock().receive(id_, message); }) session_->clock().receive(id_, message);
    return {};
  }
  void tellEdits();  // under the lock: those that this client was not told of, if it wants them
  void tell(const Outcome<editing::EditPages::Page>& page);
  // Under the lock, as all until run().
  void tellSoon(std::chrono::milliseconds pause);
  void tellNext();
  bool wake();  // false: the pool accepts no more
  void watchAcknowledgements();
  void watchRoom();  // for more triangles
  void seekRoom();
  void end();
  void refuse(wire::ErrorMessage message);

  void run();
  // The possible kinds of work.
  void work(std::monostate) {}
  void work(const conversation::Greet&);
  void work(const conversation::SendTiles& wanted);
  void work(const wire::FindEdits& find);
  void work(const conversation::SendSquares& wanted);
  void work(const conversation::Iterate& order);
  void workOnCopy();
  void chooseKey();  // under the lock
  void workOnHandOver();
  void lookUpCheckpoint();
  void found(std::string checkpoint);  // empty: there is none
  void giveUpCheckpoint();             // under the lock
  std::optional<IterationStats> restore(const camera::Camera& camera);
  std::vector<lattice::Area> followGround();  // the mesh, if there were edits; returns where it changed

  const std::shared_ptr<session::Session> session_;
  const session::Membership membership_;
  const std::uint64_t id_;
  const std::shared_ptr<conversation::Sender> sender_;
  const std::shared_ptr<scheduling::Pool> pool_;

  mutable std::mutex mutex_;
  conversation::Conversation conversation_;
  bool scheduled_ = false;  // a task is queued or runs
  scheduling::Alarm workAlarm_;
  struct {
    std::uint64_t iteration = 0;  // the last one sent when the window was full
    scheduling::Timer::Time since{};
    scheduling::Alarm alarm;
  } watched_;
  struct {
    bool isThere = false;  // at the last look
    scheduling::Alarm alarm;
  } room_;
  CameraFigures figures_;
  std::vector<session::TakeCopy> copies_;  // requested
  std::string key_;                        // of this camera's checkpoint; empty: its mesh is not handed over
  std::function<void()> handOver_;         // requested
  struct {
    std::string key;         // to be looked up; empty: it was
    std::string checkpoint;  // found
    scheduling::Alarm alarm;
  } resume_;
  std::shared_ptr<questions::Queries> queries_;  // once one was sent
  std::shared_ptr<questions::Grounds> grounds_;
  std::shared_ptr<std::atomic<std::size_t>> openEdits_ = std::make_shared<std::atomic<std::size_t>>(0);  // not yet answered and sent
  struct {
    std::uint64_t told = 0;          // edits that the client knows
    bool isOnItsWay = false;         // a page: until the next may follow it
    std::weak_ptr<const void> page;  // the last one, until it has left
    scheduling::Alarm alarm;
  } news_;  // of edits

  // Of the running task alone.
  struct Task {
    std::unique_ptr<session::IteratingMesh> mesh;
    std::unique_ptr<encoding::Encoder> encoder;
    double effectiveThreshold = 0;
    editing::Ground ground;                   // that the mesh knows
    std::shared_ptr<session::MeshCopy> copy;  // being made
  } task_;
};

}  // namespace ridgecast::member
