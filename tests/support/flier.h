#pragma once
// A client without pictures, in lock-step or by the clock, for tests that fly. It does not come back when its connection ends.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/link/client.h"
#include "common/camera/path.h"
#include "common/terrain/terrain.h"
#include "tests/support/mesh_check.h"

namespace ridgecast::testing_support {

class Flier {
 public:
  // Throws std::runtime_error when it cannot connect.
  Flier(const std::string& url, const wire::Settings& settings, wire::Pacing pacing = wire::Pacing::kLockstep);

  const wire::World& world() const { return client_->world(); }
  link::Connection& connection() { return client_->connection(); }
  const core::Scene& scene() const { return client_->scene(); }

  // One pose, sent and not waited for; its sequence.
  std::uint64_t send(const camera::Camera& camera) { return client_->send(camera); }
  // Applies and acknowledges the next iteration; nothing when none came. Throws when it cannot be applied or the hash differs.
  std::optional<wire::Iteration> take(std::chrono::milliseconds timeout);
  // One pose and its iteration. Throws when none comes.
  wire::Iteration step(const camera::Camera& camera);
  // Steps at one pose until nothing is refined any more; how many steps. Throws after `most`.
  int settle(const camera::Camera& camera, int most = 200);

  MeshReport check() const;

 private:
  std::unique_ptr<link::Client> client_;
};

// A camera path over the terrain of a world, as `ridgecast-client fly` sees it.
class PathCamera {
 public:
  PathCamera(const std::string& file, const wire::World& world);  // throws when the file or the terrain is wrong
  double duration() const { return path_.duration(); }
  camera::Camera at(double t) const;      // clamped to the path
  camera::Camera looped(double t) const;  // at its end it begins again, with a jump

 private:
  camera::Path path_;
  std::shared_ptr<const terrain::Terrain> terrain_;
};

}  // namespace ridgecast::testing_support
