#pragma once
// A client's copy of the server's mesh, and what the server must be told about it: the counterpart of server/replica. Knows no socket,
// thread or clock.
//
// Guarantee: whatever is damaged, lost or resumed on the way, the mesh becomes the server's again. Each iteration is applied all or nothing
// and its hash compared. On a mismatch, all leaves are requested again: once, until the hashes agree or nothing is held any more.
//
// Not thread-safe; one owner.

#include <optional>
#include <string>
#include <vector>

#include "client/core/mesh/scene.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

class Follower {
 public:
  // What the server must be told after an iteration, in this order.
  struct Answer {
    std::optional<wire::ResendLeaves> resend;
    wire::Acknowledge acknowledge;
    std::optional<Error> wrong;  // why the mesh held is not the server's; nothing: it is
  };

  // Before the first iteration.
  void follow(const core::Scene::Following& what) {
    points_ = what.points;
    scene_.follow(what);
  }

  // Iterations in the order of the connection. Leaves are made when they are read.
  Answer apply(const wire::Iteration& iteration) { return answer(iteration, scene_.apply(iteration)); }

  // The same in two steps, and with all leaves made: see Scene::prepare().
  Outcome<core::Scene::Prepared> prepare(const wire::Iteration& iteration) { return scene_.prepare(iteration); }
  Answer take(const wire::Iteration& iteration, Outcome<core::Scene::Prepared> prepared);

  // A connection to this world, which is the same as before, if anything is held: what to say before its first pose, so that only what is
  // missing comes.
  std::vector<wire::Resume> enter(const wire::World& world);

  const core::Scene& scene() const { return scene_; }

 private:
  Answer answer(const wire::Iteration& iteration, const Outcome<void>& applied);

  core::Scene scene_;
  bool asked_ = false;     // for all leaves, and they have not come yet
  std::string resumeKey_;  // of the last connection
  bool points_ = false;
};

}  // namespace ridgecast::core
