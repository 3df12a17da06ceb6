#pragma once
// What the tests of a session put around it: a mesh that follows a script, and a client that records what it is sent and applies it
// without knowing any of the session's code.

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "server/directory/directory.h"
#include "server/member/camera_session.h"
#include "tests/support/decoded.h"

namespace ridgecast::session {

using directory::Directory, directory::kDefaultName;
using member::CameraSession;

// A flat terrain.
std::shared_ptr<const terrain::Terrain> flatTerrain(std::uint32_t seed = 5);

// A leaf with one small triangle whose height is `content`; content 0 is an empty leaf.
mesh::LeafMesh contentOf(lattice::LeafAddress address, std::int32_t content);

// The mesh after the n-th iteration (from 1), as address -> content; what the iteration sees is noted.
struct Script {
  struct State {
    std::map<lattice::LeafAddress, std::int32_t> leaves;
    bool settled = false;
  };
  std::function<State(int iteration, const camera::Camera& camera)> next;
  std::atomic<int> iterations{0};
  std::atomic<int> alive{0};  // meshes that exist
  std::atomic<std::uint32_t> insertionLimit{0};
  std::vector<std::pair<int, wire::Settings>> changes;  // after so many iterations; look at it when one that came later was taken
  struct Ground {
    int iterations;  // before it
    std::shared_ptr<const terrain::Terrain> terrain;
    std::vector<lattice::Area> changed;
  };
  std::vector<Ground> grounds;  // the same
};
MakeMesh scriptedMeshes(const std::shared_ptr<Script>& script);

// Records what is sent; applies iterations all or nothing.
class Client : public conversation::Sender {
 public:
  void send(wire::ServerMessage message, std::shared_ptr<const void> ticket) override;
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    send(testing_support::decoded(*encoded), std::move(ticket));
  }
  std::size_t queuedBytes() const override { return queued; }
  void fail(wire::ErrorMessage message) override;

  std::atomic<std::size_t> queued{0};

  // Before anything is sent: what is held from an earlier connection.
  void hold(const mesh::LeafMesh& leaf);
  wire::Resume held() const;

  // All wait, and say nothing when it does not happen.
  std::optional<wire::World> world();
  std::optional<wire::Iteration> iteration();  // the next one not yet taken; applied already
  std::optional<wire::ErrorMessage> error();
  // Whether nothing is sent for a while.
  bool quiet(std::chrono::milliseconds time = std::chrono::milliseconds(60));
  std::uint64_t meshHash() const;
  std::vector<wire::Settings> granted() const;  // so far
  std::size_t sent() const;
  std::string complaint() const;  // what was wrong with an iteration

 private:
  void apply(const wire::Iteration& iteration);

  mutable std::mutex mutex_;
  std::vector<wire::Settings> granted_;
  std::condition_variable changed_;
  std::optional<wire::World> world_;
  std::optional<wire::ErrorMessage> error_;
  std::vector<wire::Iteration> iterations_;
  std::size_t taken_ = 0;
  std::map<lattice::LeafAddress, mesh::LeafMesh> held_;
  std::uint64_t meshHash_ = 0;
  std::string complaint_;
};

}  // namespace ridgecast::session
