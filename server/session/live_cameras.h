#pragma once
// The cameras of a session by number, to read what each holds and to tell them of new ground. Any thread.

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/outcome/contract.h"
#include "common/wire/messages.h"
#include "server/editing/edits.h"

namespace ridgecast::session {

// A camera's mesh after one of its iterations: what its client holds once it has applied that iteration.
struct MeshCopy {
  std::uint64_t iteration = 0, meshHash = 0;
  editing::Ground ground;  // of which it is a mesh
  camera::Camera camera;
  wire::Settings settings;  // as granted
  double effectiveThreshold = 0;
  std::vector<mesh::LeafMesh> leaves;  // in canonical order of address, empty ones included
};
using TakeCopy = std::function<void(std::shared_ptr<const MeshCopy>)>;

// What a session asks of a camera (member/camera_session.h). Any thread; never waits for an iteration.
class LiveCamera {
 public:
  virtual ~LiveCamera() = default;
  // The session's ground has changed: the mesh follows in the next iteration, and a client that asked for edits is told.
  virtual void groundChanged() = 0;
  // Copies the mesh between two iterations. Hands the copy over on a thread of the camera's pool; nullptr if the camera closes before
  // that. False: there was no iteration yet, or too many requests wait.
  virtual bool copy(TakeCopy done) = 0;
  // The session goes on elsewhere, or begins again here: the client must connect again.
  virtual void goAway() = 0;
};

class LiveCameras {
 public:
  void add(std::uint64_t id, std::weak_ptr<LiveCamera> camera) {
    const std::lock_guard lock(mutex_);
    expects(cameras_.emplace(id, std::move(camera)).second, "a number belongs to one camera");
  }
  void remove(std::uint64_t id) {
    const std::lock_guard lock(mutex_);
    cameras_.erase(id);
  }
  std::shared_ptr<LiveCamera> find(std::uint64_t id) const {  // nullptr: none
    const std::lock_guard lock(mutex_);
    const auto it = cameras_.find(id);
    return it == cameras_.end() ? nullptr : it->second.lock();
  }

  std::vector<std::shared_ptr<LiveCamera>> all() const {
    std::vector<std::shared_ptr<LiveCamera>> out;
    const std::lock_guard lock(mutex_);
    for (const auto& [id, camera] : cameras_)
      if (auto alive = camera.lock()) out.push_back(std::move(alive));
    return out;
  }

 private:
  mutable std::mutex mutex_;
  std::unordered_map<std::uint64_t, std::weak_ptr<LiveCamera>> cameras_;
};

}  // namespace ridgecast::session
