#pragma once
// A connection that comes back: when it ends, another one is opened, after a pause that grows and is never the same for two clients; what
// is still held is named to the server, which sends the rest, and the newest pose is sent again. The server may have been started anew, or
// have sent us to another.
//
// One owner; never blocks but in receive(). Attempts run on a thread of their own.

#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <random>
#include <stop_token>
#include <vector>

#include "client/connection/connection.h"

namespace ridgecast::connection {

class Resuming {
 public:
  // Called in receive(), before anything of a new connection is received: what is still held. `world` is the new connection's; where its
  // content_hash is another one, nothing that is held is of use. (See scene::Scene::reconnect and held.)
  using Held = std::function<std::vector<wire::HeldLeaf>(const wire::World& world)>;

  struct Pauses {
    std::chrono::milliseconds first{50}, longest{2000};  // each is taken times 0.5 to 1
    std::chrono::milliseconds patience{5000};            // of one attempt
  };

  // The first connection must succeed; `waiting` is for it alone.
  static Outcome<std::unique_ptr<Resuming>> open(const Url& url, const wire::Hello& hello, Held held, const Pauses& pauses,
                                                 const Waiting& waiting = {});
  static Outcome<std::unique_ptr<Resuming>> open(const Url& url, const wire::Hello& hello, Held held, const Waiting& waiting = {}) {
    return open(url, hello, std::move(held), Pauses{}, waiting);
  }
  ~Resuming() { stop_.request_stop(); }  // an attempt is given up

  // Of the newest connection; a reference stays good until receive() is called.
  const wire::World& world() const { return connection_->world(); }

  // As Connection's; what is said while there is none is forgotten, but for the newest pose.
  void send(const wire::PoseMessage& pose);
  void acknowledge(const wire::Acknowledge& acknowledge);
  void resend(const wire::ResendLeaves& resend);
  // Also what the next connections ask for.
  void change(const wire::Settings& settings);
  wire::Settings granted() const { return connection_->granted(); }

  // Tiles that were wanted of an ended connection never come: ask again after reconnections() has grown.
  void want(const wire::WantTiles& wanted) {
    if (!lost_) connection_->want(wanted);
  }
  std::vector<wire::HeightTile> takeTiles() { return lost_ ? std::vector<wire::HeightTile>() : connection_->takeTiles(); }

  // As Connection's; also looks after the connection, so call it often.
  std::optional<Received> receive(std::chrono::milliseconds patience);

  // The other members, as Connection's; with hello.members. What was seen of a connection before is void: begin with 0 when
  // reconnections() has grown.
  std::optional<Roster> others(std::uint64_t seen = 0) const { return lost_ ? std::nullopt : connection_->others(seen); }

  std::optional<Error> error() const;  // why there is no connection at the moment
  std::uint64_t bytesReceived() const { return bytesBefore_ + connection_->bytesReceived(); }
  std::uint64_t reconnections() const { return reconnections_; }

 private:
  using Clock = std::chrono::steady_clock;
  Resuming(Url url, wire::Hello hello, Held held, const Pauses& pauses, std::unique_ptr<Connection> connection);
  void lookAfter();
  void pause();

  const Url url_;
  Url target_;  // of the next attempt: where a server that left has sent us, and, when nobody is there, where we came from
  wire::Hello hello_;
  const Held held_;
  const Pauses pauses_;
  std::unique_ptr<Connection> connection_;  // never null; the ended one until there is another
  std::stop_source stop_;
  std::future<Outcome<std::unique_ptr<Connection>>> attempt_;
  std::optional<Error> lost_;
  Clock::time_point next_{};  // attempt
  std::chrono::milliseconds pause_;
  std::minstd_rand random_{std::random_device{}()};
  std::optional<wire::PoseMessage> pose_;
  std::uint64_t bytesBefore_ = 0, reconnections_ = 0;
};

}  // namespace ridgecast::connection
