#pragma once
// The client side of a server's stream: a connection that reconnects by itself, and the mesh, kept equal to the server's.
//
//     auto client = link::Client::open(url, hello);
//     (*client)->send(camera);
//     while (auto update = (*client)->receive(timeout)) draw((*client)->scene());
//
// One owner; blocks only in open(), receive() and await().

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "client/core/ground/height_window.h"
#include "client/core/ground/held_edits.h"
#include "client/core/mesh/follower.h"
#include "client/core/mesh/scene.h"
#include "client/link/connection.h"
#include "common/camera/camera.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::link {

// An iteration that was applied and acknowledged.
struct Update {
  wire::Iteration iteration;
  std::uint64_t bytes = 0;     // of its message
  double milliseconds = 0;     // of decoding; after poll() with all leaves made
  std::optional<Error> wrong;  // why the mesh held is not the server's, and leaves were requested again; nothing: it is
};

class Client {
 public:
  static Outcome<std::unique_ptr<Client>> open(const core::Url& url, const wire::Hello& hello, const Options& options = {});

  // If connection().otherWorld(): enters that world with the same hello, replacing the one held. The mesh is empty then; sequences
  // continue. Blocks like open(). Error: as open()'s; the client is unchanged.
  Outcome<void> enterOtherWorld();

  const core::Scene& scene() const { return follower_.scene(); }
  const wire::World& world() const { return connection_->world(); }  // good until receive(), poll() or await() is called
  Connection& connection() { return *connection_; }
  const Connection& connection() const { return *connection_; }
  std::uint64_t resumed() const { return resumed_; }  // leaves that were named to later connections

  // Never blocks. Returns the pose's sequence, ascending from 1. `state`: what the other members hear of this one, at most
  // wire::kMaxStateBytes.
  std::uint64_t send(const camera::Camera& camera, std::vector<std::uint8_t> state = {});

  // The next iteration; nothing if none came within `timeout` (connection().error() says why).
  std::optional<Update> receive(std::chrono::milliseconds timeout);

  // Receives until an iteration of this pose or a later one has come, and returns it. Errors: the connection is lost, or the server does
  // not answer within `timeout`.
  Outcome<Update> await(std::uint64_t sequence, std::chrono::milliseconds timeout);

  // Takes a height map's tiles that have come and requests missing ones; never blocks. One window a client. Returns whether any came.
  // Error: the server sent no tile, or one that was not requested.
  Outcome<bool> exchangeTiles(core::HeightWindow& window);

  // The same for edits of the ground: takes what has come, and requests what is missing as of the newest iteration. Does nothing if the
  // terrain is private or the server sends none (World::revision below 5).
  Outcome<bool> exchangeEdits(core::HeldEdits& edits);

  // Like receive(), but does not wait for an iteration to come, and at most `soon` for it to be decoded. Decoding continues on its own
  // thread, which calls `ready`; a later call returns the iteration. scene() may be read meanwhile. Makes all leaves: for windows.
  std::optional<Update> poll(std::chrono::milliseconds soon, const std::function<void()>& ready);

 private:
  struct Decoding {
    core::Received received;
    double milliseconds = 0;
    std::future<Outcome<core::Scene::Prepared>> prepared{};
  };
  Client(const core::Url& url, wire::Hello hello, const Options& options) : url_(url), hello_(std::move(hello)), options_(options) {}
  std::optional<core::Received> hear(std::chrono::milliseconds timeout);  // as Connection::receive()
  Update answer(Decoding&& decoding, core::Follower::Answer answer);

  const core::Url url_;
  const wire::Hello hello_;
  const Options options_;
  core::Follower follower_;
  std::unique_ptr<Connection> connection_;  // never null
  std::uint64_t sequence_ = 0, resumed_ = 0;
  std::uint64_t tilesFrom_ = 0, editsFrom_ = 0;  // reconnections() when tiles, and edits, were last exchanged
  std::uint64_t edit_ = 0, editOf_ = 0;          // the newest that the mesh knows, in the session of these reconnections()
  std::unique_ptr<Decoding> decoding_;
};

}  // namespace ridgecast::link
