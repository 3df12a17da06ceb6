#pragma once
// A connection that comes back: when it ends, another one is opened after a pause. The pause grows until an iteration of a connection was
// applied, and is random, so that a thousand clients do not come back at once. The new connection says first what is still held, then the
// newest pose. The server may have been started again, or may have sent us to another one.
//
// One owner, but for ask(); never blocks but in receive(). Attempts run on a thread of their own.

#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <stop_token>
#include <utility>
#include <vector>

#include "client/connection/connection.h"

namespace ridgecast::connection {

class ReconnectingConnection {
 public:
  // Called in receive() when another connection has begun: what to say before its first pose.
  using Resume = std::function<std::vector<wire::Resume>()>;
  struct Options {
    bool reconnects = true;                     // false: the first loss is the end
    std::chrono::milliseconds timeout{10'000};  // of the first connection, which must succeed
    Waiting waiting = {};                       // for the first connection
  };
  static Outcome<std::unique_ptr<ReconnectingConnection>> open(const Url& url, const wire::Hello& hello, Resume resume,
                                                               const Options& options);
  ~ReconnectingConnection() { stop_.request_stop(); }  // an attempt is given up

  // The newest connection, for everything that is not below. While there is none it is the ended one, which sends nothing. Good until
  // receive() is called. Requests and news of an earlier one are void: begin again when reconnections() has grown.
  Connection* operator->() const { return connection_.get(); }
  Connection& operator*() const { return *connection_; }

  const wire::World& world() const { return connection_->world(); }
  void send(const wire::PoseMessage& pose);
  // Also what later connections ask for.
  void change(const wire::Settings& settings);
  void skipSteps(bool skips);
  // An iteration was, without an error: the next loss is a new one.
  void applied() { pause_ = kFirstPause; }
  // Any thread.
  std::future<Outcome<wire::Answer>> ask(wire::Query query);
  bool followsEdits() const { return connection_->followsEdits(); }
  std::vector<wire::MadeEdit> takeEdits();  // another connection begins with the first
  // As Connection's; also looks after the connection, so call it often.
  std::optional<core::Received> receive(std::chrono::milliseconds timeout);

  std::optional<Error> error() const { return lost_; }  // why there is no connection at the moment
  // The server came back with another world: what is held is of no use there, and no further attempt is made.
  bool otherWorld() const { return otherWorld_; }
  bool comesBack() const { return reconnects_ && !otherWorld_; }  // where it is lost, another attempt is made
  std::uint64_t bytesReceived() const { return bytesBefore_ + connection_->bytesReceived(); }
  std::uint64_t reconnections() const { return reconnections_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kFirstPause{50}, kLongestPause{2000};  // each is taken times 0.5 to 1
  ReconnectingConnection(Url url, wire::Hello hello, Resume resume, bool reconnects, std::unique_ptr<Connection> connection);
  void lookAfter();
  void noteLoss();
  void adopt(std::unique_ptr<Connection> connection);
  void pause();

  const Url url_;
  Url target_;  // of the next attempt: where a server that left has sent us, and, when nobody is there, where we came from
  wire::Hello hello_;
  const Resume resume_;
  const bool reconnects_;
  bool otherWorld_ = false;
  bool skipsSteps_ = false;
  mutable std::mutex asks_;                 // guards connection_ where ask() reads it and the owner replaces it
  std::shared_ptr<Connection> connection_;  // never null; the ended one until there is another
  std::stop_source stop_;
  std::future<Outcome<std::unique_ptr<Connection>>> attempt_;
  std::optional<Error> lost_;
  Clock::time_point next_{};  // attempt
  std::chrono::milliseconds pause_ = kFirstPause;
  std::minstd_rand random_{std::random_device{}()};
  std::optional<wire::PoseMessage> pose_;
  std::uint64_t bytesBefore_ = 0, reconnections_ = 0;
};

}  // namespace ridgecast::connection
