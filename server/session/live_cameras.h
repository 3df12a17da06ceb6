#pragma once
// The cameras of a session by number, to read what each holds. Any thread.

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "common/mesh/leaf_mesh.h"
#include "common/wire/messages.h"
#include "server/session/edits.h"

namespace ridgecast::session {

class CameraSession;

// A camera's mesh after one of its iterations: what its client holds once it has applied that iteration.
struct MeshCopy {
  std::uint64_t iteration = 0, meshHash = 0;
  Ground ground;  // of which it is a mesh
  camera::Camera camera;
  wire::Settings settings;  // as granted
  double effectiveThreshold = 0;
  std::vector<mesh::LeafMesh> leaves;  // in canonical order of address, empty ones included
};
using TakeCopy = std::function<void(std::shared_ptr<const MeshCopy>)>;

class LiveCameras {
 public:
  void add(std::uint64_t id, std::weak_ptr<CameraSession> camera) {
    const std::lock_guard lock(mutex_);
    cameras_[id] = std::move(camera);
  }
  void remove(std::uint64_t id) {
    const std::lock_guard lock(mutex_);
    cameras_.erase(id);
  }
  std::shared_ptr<CameraSession> find(std::uint64_t id) const {  // nullptr: none
    const std::lock_guard lock(mutex_);
    const auto it = cameras_.find(id);
    return it == cameras_.end() ? nullptr : it->second.lock();
  }

  std::vector<std::shared_ptr<CameraSession>> all() const {
    std::vector<std::shared_ptr<CameraSession>> out;
    const std::lock_guard lock(mutex_);
    for (const auto& [id, camera] : cameras_)
      if (auto alive = camera.lock()) out.push_back(std::move(alive));
    return out;
  }

 private:
  mutable std::mutex mutex_;
  std::unordered_map<std::uint64_t, std::weak_ptr<CameraSession>> cameras_;
};

}  // namespace ridgecast::session
