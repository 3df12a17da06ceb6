#pragma once
// Named worlds and who is in them.
//
// A Session is a terrain with its seed that several cameras look at; it never changes while it lives. The Directory holds the sessions
// by name; `default` is always there. Every camera has a mesh, a replica and a pool of its own (camera_session.h).

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <unordered_map>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/pipeline/pipeline.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "server/session/alarm.h"
#include "server/session/iterating_mesh.h"
#include "server/session/presence.h"

namespace ridgecast::session {

struct Limits {
  std::uint32_t maxCameras = 256;  // of all sessions together
  std::uint32_t maxMembers = 64;   // of one session
  std::uint32_t window = replica::kDefaultWindow;
  std::size_t maxQueuedBytes = 8u << 20;  // no iteration begins while more than this waits in a client's way out
  std::uint64_t maxBytesPerSecond = 0;    // of one client's iterations; 0: no limit
  pipeline::Limits mesh;
  bool sendsTerrain = true;  // false: World's terrain_source stays empty
};

inline constexpr std::string_view kDefaultName = "default";
// What the session remembers of the leaves that a client holds, to make deltas from: so many bytes a triangle of its budget at most.
inline constexpr std::size_t kBaseBytesPerTriangle = 24;
inline constexpr std::uint64_t kLeastBytesPerSecond = 4096;
inline constexpr std::size_t kMaxQueuedPoses = 64;  // lock-step: poses that wait for their iteration

// What cameras of all sessions share.
struct Resources {
  // Not owned: a task may be the last owner of anything here, and a machine cannot be destroyed by its own threads. Destroyed after
  // the sockets are closed; tasks that are left then are dropped.
  scheduling::Machine* machine = nullptr;
  MakeMesh makeMesh;
  std::string serverName;
  Limits limits;
  mutable std::atomic<bool> givesMemoryBack{false};  // an alarm that trims the allocator is set
  Alarm alarm;                                       // wakes cameras whose budget of bytes is used up
};

// One camera's place; given back when destroyed.
class Place {
 public:
  Place(std::shared_ptr<std::atomic<std::uint32_t>> members, std::shared_ptr<std::atomic<std::uint32_t>> cameras)
      : members_(std::move(members)), cameras_(std::move(cameras)) {}
  Place(Place&&) = default;
  Place& operator=(Place&&) = delete;
  ~Place() {
    if (!members_) return;
    --*members_;
    --*cameras_;
  }

 private:
  std::shared_ptr<std::atomic<std::uint32_t>> members_, cameras_;
};

// Immutable but for its members and their clock; any thread.
class Session {
 public:
  Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, std::shared_ptr<const Resources> resources,
          std::shared_ptr<std::atomic<std::uint32_t>> cameras);

  const std::string& name() const { return name_; }
  const std::shared_ptr<const terrain::Terrain>& terrain() const { return terrain_; }
  std::uint64_t contentHash() const { return contentHash_; }
  const Resources& resources() const { return *resources_; }
  std::uint32_t members() const { return *members_; }
  Presence& presence() const { return *presence_; }

  // Error: the session or the server is full.
  Outcome<Place> enter();

 private:
  std::string name_;
  std::shared_ptr<const terrain::Terrain> terrain_;
  std::uint64_t contentHash_;
  std::shared_ptr<const Resources> resources_;
  std::shared_ptr<std::atomic<std::uint32_t>> members_, cameras_;
  std::shared_ptr<Presence> presence_;
};

// Any thread.
class Directory {
 public:
  Directory(std::shared_ptr<const Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain);

  std::shared_ptr<Session> find(std::string_view name) const;  // none: nullptr
  // Error: the name is taken or cannot be one.
  Outcome<std::shared_ptr<Session>> add(std::string name, std::shared_ptr<const terrain::Terrain> terrain);

  const Resources& resources() const { return *resources_; }
  std::uint32_t cameras() const { return *cameras_; }
  std::uint64_t nextCameraId() { return ++lastCameraId_; }

 private:
  std::shared_ptr<const Resources> resources_;
  std::shared_ptr<std::atomic<std::uint32_t>> cameras_ = std::make_shared<std::atomic<std::uint32_t>>(0);
  std::atomic<std::uint64_t> lastCameraId_{0};
  mutable std::mutex mutex_;
  std::unordered_map<std::string, std::shared_ptr<Session>> sessions_;
};

}  // namespace ridgecast::session
