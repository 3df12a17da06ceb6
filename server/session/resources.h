#pragma once
// What all sessions of a server and their cameras share: limits, threads, time, budgets, and how meshes, terrains and recordings are made.

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "server/bus/brief_records.h"
#include "server/bus/bus.h"
#include "server/editing/edit_space.h"
#include "server/metrics/metrics.h"
#include "server/pipeline/pipeline.h"
#include "server/recording/events.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "server/scheduling/timer.h"
#include "server/session/budgets.h"
#include "server/session/slot_queue.h"
#include "server/session/world_spec.h"

namespace ridgecast::session {

inline constexpr std::uint64_t kMinBytesPerSecond = 4096;  // that a member is granted
inline constexpr std::uint64_t kBytesPerTriangle = 160;    // of a camera's mesh, replica and bases

struct Limits {
  std::uint32_t maxCameras = 256;                  // of all sessions together
  std::uint64_t maxTotalTriangles = 0;             // budgets of all cameras together (camera_quota.h); 0: unlimited
  std::uint32_t maxMembers = 4096;                 // of one session; no more than maxCameras
  std::uint32_t maxSessions = 64;                  // `default` included
  std::uint32_t maxSessionsPerClient = 16;         // that live and that it has made; 0: unlimited
  std::chrono::milliseconds sessionIdle{300'000};  // a session ends after this time without members, queries and snapshots
  std::uint32_t window = replica::kDefaultWindow;
  std::size_t maxQueuedBytes = 8u << 20;                  // no iteration starts while more than this is queued for a client
  std::uint64_t maxHeightsPerSecond = kHeightsPerSecond;  // for one client's answers; 0: unlimited
  std::uint64_t maxBytesPerSecond = 0;                    // of one client's iterations; 0: unlimited
  pipeline::Limits mesh;
  std::chrono::milliseconds turn = scheduling::kTurn;  // of work on an answer, a ground or edits, before others have theirs
  bool sendsTerrain = true;                            // false: World's terrain_source stays empty
  bool takesEdits = true;                              // of members; false: the ground is that of a recording
};

using pipeline::IteratingMesh;
using MakeMesh = std::function<std::unique_ptr<IteratingMesh>(std::shared_ptr<const terrain::Terrain> terrain,
                                                              const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool)>;
MakeMesh pipelineMeshes();  // makes pipelines

// Begins a session's recording. `past`: the edits that have made its ground.
using Record =
    std::function<std::shared_ptr<recording::Observer>(recording::World, std::vector<recording::Edited> past, scheduling::Timer::Time now)>;

// Shared by the cameras of all sessions.
struct Resources {
  // Not owned: a task may be the last owner of anything here, and an executor cannot be destroyed by its own threads. Destroyed after the
  // sockets are closed; remaining tasks are dropped.
  scheduling::Executor* executor = nullptr;
  // Of one thread each. One makes edits, which would wait for an iteration of some camera four times over; the other writes and reads them,
  // so that no other waits for a disk. Null: `executor` does.
  scheduling::Executor *edits = nullptr, *disk = nullptr;
  scheduling::Executor& editor() const { return edits ? *edits : *executor; }
  scheduling::Executor& writer() const { return disk ? *disk : *executor; }
  MakeMesh makeMesh;
  MakeTerrain makeTerrain;      // for sessions that clients create; empty: not allowed
  std::filesystem::path state;  // folder of the sessions' logs of edits; empty: edits are forgotten when their session ends
  Record record;                // empty: sessions are not recorded
  std::string serverName;
  Limits limits;
  std::shared_ptr<bus::Bus> bus = std::make_shared<bus::Alone>();  // to the other servers of these worlds
  std::shared_ptr<bus::BriefRecords> checkpoints = std::make_shared<bus::BriefRecords>("checkpoints");  // of cameras that leave
  std::shared_ptr<editing::EditSpace> editSpace = std::make_shared<editing::EditSpace>();
  std::shared_ptr<BudgetsByClient> budgets = std::make_shared<BudgetsByClient>();
  std::shared_ptr<metrics::Metrics> figures = std::make_shared<metrics::Metrics>();
  std::unique_ptr<const scheduling::Timer> timer = std::make_unique<scheduling::SteadyTimer>();
  const QueryQueues& queryQueues() const {
    std::call_once(queuesMade_, [this] { queues_.emplace(*executor); });
    return *queues_;
  }
  mutable std::atomic<bool> givesMemoryBack{false};  // a call to trim the allocator is scheduled

 private:
  mutable std::once_flag queuesMade_;  // by the first camera that asks
  mutable std::optional<QueryQueues> queues_;
};

}  // namespace ridgecast::session
