#pragma once
// One connection between a member and its camera on the server, without a network: messages as bytes, in order, each way with a delay; to
// the client no faster than its bandwidth, the rest being queued on the server. It may be cut: what is under way is lost, and the server
// hears of it later.

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/wire/wire.h"
#include "server/member/camera_session.h"
#include "tests/simulation/server.h"
#include "tests/support/decoded.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::simulation {

using testing_support::SimulatedTimer;

class Line final : public conversation::Sender, public std::enable_shared_from_this<Line> {
 public:
  struct Way {
    Duration delay{};             // each way
    double bytesPerSecond = 1e9;  // to the client
  };
  using Take = std::function<void(const std::string& frame)>;

  // To a camera of its own in this session, of this client. Null: there is no place, the session is made, which takes so long, or the
  // server does not run. `opened` is called once, at once where servers share nothing.
  using Opened = std::function<void(std::shared_ptr<Line>)>;
  static void open(Server& server, const std::string& session, const std::string& client, const SimulatedTimer& timer, Way way, Take take,
                   const Opened& opened, Duration entering = {});
  Line(Server& server, const std::string& session, const SimulatedTimer& timer, Way way, Take take)  // for open()
      : server_(server),
        openEditsOfAll_(server.openEdits(session)),
        timer_(timer),
        way_(way),
        maxQueuedBytes_(server.directory()->resources().limits.maxQueuedBytes),
        take_(std::move(take)) {}

  // The member's end.
  void say(std::string frame);
  void say(const wire::ClientMessage& message) { say(wire::encode(message)); }
  // `unheard`: how long the server takes the line for open.
  void cut(Duration unheard);
  // Nothing more is read for so long.
  void stall(Duration time) { quietFrom_ = left_ = std::max(left_, timer_.now()) + time; }
  bool isOpen() const { return !cut_ && !fell_; }
  // When all that was said and sent until now has arrived, but for questions about the time, which never end.
  Time quietFrom() const { return quietFrom_; }

  // The server's end.
  void fall();                    // the server is gone: only what has left it may still arrive
  void sendAway(Duration after);  // the server leaves: to another one, where the camera's mesh may go before
  void send(wire::ServerMessage message, std::shared_ptr<const void> ticket) override;
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    send(testing_support::decoded(*encoded), std::move(ticket));
  }
  std::size_t queuedBytes() const override { return queued_; }
  void fail(wire::ErrorMessage message) override { send(std::move(message), {}); }

 private:
  static std::shared_ptr<Line> begin(Server& server, const std::string& name, const std::string& client, const SimulatedTimer& timer,
                                     Way way, Take take, const std::shared_ptr<session::Session>& session);
  void goAway();
  void hear(wire::ClientMessage message);
  void opens(const wire::Edit& edit);
  void closes(std::uint64_t edit);  // by id
  void leaves(const wire::ServerMessage& message);
  void judge(const wire::Iteration& iteration);

  Server& server_;
  Server::OpenEdits& openEditsOfAll_;
  const SimulatedTimer& timer_;
  const Way way_;
  const std::size_t maxQueuedBytes_;
  const Take take_;
  std::shared_ptr<member::CameraSession> camera_;
  Time said_{};  // when the last of the member's messages arrives
  Time left_{};  // when the last of the server's messages leaves
  Time quietFrom_{};
  std::size_t queued_ = 0, queuedMembers_ = 0, queuedPages_ = 0;
  std::size_t granted_ = 0;  // bytes of what was sent last, if it says what is granted: the iteration that follows was begun before
  std::vector<std::shared_ptr<const void>> stuck_;  // tickets of what will never leave
  bool cut_ = false;
  std::optional<Time> fell_;
  std::size_t openEdits_ = 0;                       // that have arrived and have no answer
  std::multimap<std::uint64_t, std::string> keys_;  // of those, by id
  std::string author_;                              // as in the log
  bool failed_ = false, isLockstep_ = false;
  std::uint64_t newestPose_ = 0;  // that has arrived
  std::uint64_t edit_ = 0;        // of the last iteration
  std::uint64_t acknowledged_ = 0, window_ = 0;
};

}  // namespace ridgecast::simulation
