#pragma once
// Named worlds and their members.
//
// A Session is a terrain with its seed and parameters, seen by several cameras; its world never changes while it lives (a successor may
// take its name: Directory::replace); its ground changes only by edits (edits.h). The Directory holds the sessions by name. `default`
// always exists; the others end after a while without members, and within seconds if nobody has said hello in them; their edits are kept,
// if there is a place for them. One client may have made at most Limits::maxSessionsPerClient of the live sessions. Every camera has its
// own mesh, replica and pool (camera_session.h).

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/metrics/metrics.h"
#include "server/pipeline/pipeline.h"
#include "server/recording/events.h"
#include "server/replica/replica.h"
#include "server/scheduling/pool.h"
#include "server/session/edit_pages.h"
#include "server/session/edit_space.h"
#include "server/session/edits.h"
#include "server/session/live_cameras.h"
#include "server/session/place_queue.h"
#include "server/session/places.h"
#include "server/session/presence.h"
#include "server/session/reservations.h"
#include "server/session/timer.h"

namespace ridgecast::session {

struct Limits {
  std::uint32_t maxCameras = 256;                  // of all sessions together
  std::uint64_t maxTotalTriangles = 0;             // budgets of all cameras together (places.h); 0: unlimited
  std::uint32_t maxMembers = 64;                   // of one session
  std::uint32_t maxSessions = 64;                  // `default` included
  std::uint32_t maxSessionsPerClient = 16;         // that live and that it has made; 0: unlimited
  std::chrono::milliseconds sessionIdle{300'000};  // a session ends after this time without members, queries and snapshots
  std::uint32_t window = replica::kDefaultWindow;
  std::size_t maxQueuedBytes = 8u << 20;  // no iteration starts while more than this is queued for a client
  std::uint64_t maxBytesPerSecond = 0;    // of one client's iterations; 0: unlimited
  pipeline::Limits mesh;
  std::chrono::milliseconds turn = kTurn;  // of work on an answer, a ground or edits, before others have theirs
  bool sendsTerrain = true;                // false: World's terrain_source stays empty
  bool takesEdits = true;                  // of members; false: the ground is that of a recording
};

using pipeline::IteratingMesh;
using MakeMesh = std::function<std::unique_ptr<IteratingMesh>(std::shared_ptr<const terrain::Terrain> terrain,
                                                              const settings::Settings& granted, std::shared_ptr<scheduling::Pool> pool)>;
MakeMesh pipelineMeshes();  // makes pipelines

// What a world is made of. Terrain and parameters by name, as in `--terrain` and `--param`.
struct WorldSpec {
  std::string terrain;
  std::uint32_t seed = 1;
  std::vector<std::pair<std::string, double>> parameters;  // those that differ from the terrain's defaults; ascending by name
  wire::ClockMode clock = wire::ClockMode::kRealTime;      // how its clock begins: in real time or stepped, standing at 0
  friend bool operator==(const WorldSpec&, const WorldSpec&) = default;
};
// May take seconds if a terrain must be compiled; a requested stop ends that within milliseconds. Any thread. Error: one sentence for the
// user, or a stop.
using MakeTerrain = std::function<Outcome<std::shared_ptr<const terrain::Terrain>>(const WorldSpec&, const std::stop_token& stop)>;

inline constexpr std::string_view kDefaultName = "default";
inline constexpr std::chrono::milliseconds kUnenteredIdle{5'000};  // of a client's session that nobody has used; at most sessionIdle
inline constexpr std::uint64_t kMinBytesPerSecond = 4096;
inline constexpr std::uint32_t kMaxMembers = 32'768;  // of a session: they fit into one wire::Members

// Begins a session's recording. `past`: the edits that have made its ground.
using Record = std::function<std::shared_ptr<recording::Observer>(recording::World, std::vector<recording::Edited> past, Timer::Time now)>;

// Shared by the cameras of all sessions.
struct Resources {
  // Not owned: a task may be the last owner of anything here, and an executor cannot be destroyed by its own threads. Destroyed after the
  // sockets are closed; remaining tasks are dropped.
  scheduling::Executor* executor = nullptr;
  // Of one thread, which writes and reads edits, so that no other waits for a disk. Null: `executor` does.
  scheduling::Executor* disk = nullptr;
  scheduling::Executor& writer() const { return disk ? *disk : *executor; }
  MakeMesh makeMesh;
  MakeTerrain makeTerrain;      // for sessions that clients create; empty: not allowed
  std::filesystem::path state;  // folder of the sessions' logs of edits; empty: edits are forgotten when their session ends
  Record record;                // empty: sessions are not recorded
  std::string serverName;
  Limits limits;
  std::shared_ptr<EditSpace> editSpace = std::make_shared<EditSpace>();
  std::shared_ptr<metrics::Metrics> figures = std::make_shared<metrics::Metrics>();
  std::unique_ptr<const Timer> timer = std::make_unique<SteadyTimer>();
  const QueryQueues& questions() const {
    std::call_once(questionsMade_, [this] { questions_.emplace(*executor); });
    return *questions_;
  }
  mutable std::atomic<bool> givesMemoryBack{false};  // a call to trim the allocator is scheduled

 private:
  mutable std::once_flag questionsMade_;  // by the first camera that asks
  mutable std::optional<QueryQueues> questions_;
};

// One unit of a limited resource; released with its last copy.
using Place = std::shared_ptr<const void>;

inline constexpr std::uint64_t kBytesPerTriangle = 160;  // of a camera's mesh, replica and bases

// One camera's place on the server and in its session.
struct CameraPlace {
  std::shared_ptr<Places::Place> onServer;
  Place inSession;
  std::shared_ptr<Budgets> budgets;
  std::string client;  // as http::Request::client; empty: nobody knows
};

// Immutable except for its members, their clock and their edits; any thread.
class Session {
 public:
  Session(std::string name, std::shared_ptr<const terrain::Terrain> terrain, WorldSpec spec, std::shared_ptr<const Resources> resources,
          std::shared_ptr<Places> places, Edits::Kept kept = {});

  const std::string& name() const { return name_; }
  Ground ground() const { return edits_->ground(); }
  std::shared_ptr<const terrain::Terrain> terrain() const { return ground().terrain; }  // of ground()
  Edits& edits() const { return *edits_; }
  EditPages& editPages() const { return *editPages_; }
  // Asks for the edit, charged to these budgets. `done` as Edits::Done.
  void edit(Edit edit, std::shared_ptr<Budgets> budgets, std::function<void(const Edits::Answer& number)> done);
  const WorldSpec& spec() const { return spec_; }
  std::uint64_t contentHash() const { return contentHash_; }  // of the world, whatever its edits
  std::uint64_t hashOf(const Ground& ground) const;           // of world and edits: another for other ground
  const Resources& resources() const { return *resources_; }
  std::uint32_t members() const { return *members_ & ~kEnded; }
  Presence& presence() const { return *presence_; }
  LiveCameras& live() const { return *live_; }
  recording::Observer* observer() const { return observer_.get(); }  // null: it is not recorded
  // Tells the observer, of what happens now.
  void note(recording::Event event) const {
    if (observer_) observer_->note(resources_->timer->now(), std::move(event));
  }

  // `client`: whose budgets the camera shares (Places::budgetsOf). Error: the session or the server is full, or the session has just ended.
  Outcome<CameraPlace> enter(const std::string& client = {});
  // What this client's cameras and queries share (Places::budgetsOf).
  std::shared_ptr<Budgets> budgetsOf(const std::string& client) const { return places_->budgetsOf(client, resources_->timer->now()); }
  // Ends it if it has no members; then nobody can enter or edit.
  bool end();
  // It was ended, or has a successor: a client that enters now must connect again, and nobody can edit.
  void retire();
  bool isRetired() const { return isRetired_; }
  // A member has said hello, or a client without a place uses it: an idle session that is used does not end.
  void use() { ++uses_; }
  std::uint64_t uses() const { return uses_; }

 private:
  static constexpr std::uint32_t kEnded = 1u << 31;  // flag in members_, whose count is then 0
  std::string name_;
  WorldSpec spec_;
  std::atomic<std::uint64_t> uses_{0};
  std::atomic<bool> isRetired_{false};
  std::uint64_t contentHash_;
  const std::uint64_t nonce_;  // the next session of this name may give its edits the same numbers
  std::shared_ptr<const Resources> resources_;
  std::shared_ptr<std::atomic<std::uint32_t>> members_;
  std::shared_ptr<Places> places_;
  std::shared_ptr<recording::Observer> observer_;
  std::shared_ptr<Presence> presence_;
  std::shared_ptr<LiveCameras> live_ = std::make_shared<LiveCameras>();
  std::shared_ptr<Edits> edits_;
  std::shared_ptr<EditPages> editPages_;
};

// Any thread. Idle sessions end only if a shared_ptr holds this.
class Directory : public std::enable_shared_from_this<Directory> {
 public:
  // Throws std::runtime_error with one sentence when Resources::state cannot be written, or the default session's edits cannot be read.
  // There is no default session while another server has it.
  Directory(std::shared_ptr<const Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain,
            std::vector<std::pair<std::string, double>> defaultParameters = {});

  std::shared_ptr<Session> find(std::string_view name) const;  // none: nullptr
  // Whether edits are kept of a session of this name.
  bool keeps(const std::string& name) const { return reservations_.hasLog(name); }
  // The right to add the session of a valid name. Null: it lives, is being added, or has ended and is closing its log: find() it, or ask
  // again in a moment. Error: one sentence; another server has it, or its edits cannot be read.
  Outcome<std::unique_ptr<Reservation>> reserve(const std::string& name) const;
  // Adds the session with the edits kept of it, which may take seconds. `maker`: the client, as http::Request::client; empty: the operator,
  // who has no share. Error: full(), or the edits that are kept are of another world.
  Outcome<std::shared_ptr<Session>> add(std::unique_ptr<Reservation> reservation, std::shared_ptr<const terrain::Terrain> terrain,
                                        std::vector<std::pair<std::string, double>> parameters = {}, std::string maker = {},
                                        wire::ClockMode clock = wire::ClockMode::kRealTime);
  // Likewise. Error: also if the name is taken or invalid.
  Outcome<std::shared_ptr<Session>> add(const std::string& name, std::shared_ptr<const terrain::Terrain> terrain,
                                        std::vector<std::pair<std::string, double>> parameters = {}, std::string maker = {},
                                        wire::ClockMode clock = wire::ClockMode::kRealTime);
  // A session of the same name, maker and spec with another ground takes the place of this one, which is retired: its members have their
  // places until they leave. `prepare` is called with the successor before anybody can find it. Returns false if it has ended already.
  bool replace(const std::shared_ptr<Session>& session, std::shared_ptr<const terrain::Terrain> terrain,
               const std::function<void(const Session& successor)>& prepare = {});
  // Ends a session for the operator: its name is free, and a client that enters it now must connect again. The caller sends its members
  // away. Null: there is none, or it is the default one.
  std::shared_ptr<Session> remove(std::string_view name);
  std::vector<std::shared_ptr<Session>> all() const;  // by name
  // Why this maker cannot add another session now: the server is at its limit, or the maker at its share.
  struct Full {
    bool isOwn;  // the share
    std::string sentence;
  };
  std::optional<Full> full(std::string_view maker) const;

  // Of a valid name that find() does not know: whether another server has it, which will let go of it.
  bool isElsewhere(const std::string& name) const { return reservations_.isElsewhere(name); }
  // If another server has the default session, takes it as soon as that server releases it. Call once, before anybody asks for it.
  void awaitDefault();

  const Resources& resources() const { return *resources_; }
  std::uint32_t cameras() const { return places_->cameras(); }
  std::uint64_t triangles() const { return places_->triangles(); }  // set aside for the cameras
  std::uint64_t nextCameraId() { return ++lastCameraId_; }
  void startCameraIdsAfter(std::uint64_t last) { lastCameraId_ = last; }  // before anybody has one

 private:
  std::shared_ptr<const Resources> resources_;
  std::shared_ptr<Places> places_;
  const Reservations reservations_;
  Outcome<std::shared_ptr<Session>> addDefault();
  const struct {
    std::shared_ptr<const terrain::Terrain> terrain;
    std::vector<std::pair<std::string, double>> parameters;
  } default_;
  std::shared_ptr<scheduling::Pool> awaiting_;  // the default session
  std::atomic<std::uint64_t> lastCameraId_{0};
  struct Kept {
    std::shared_ptr<Session> session;
    std::string maker;
    // It had no members at `idleSince`, and nobody has used it since.
    std::uint64_t uses = 0;
    std::optional<std::chrono::steady_clock::time_point> idleSince;
  };
  std::optional<Full> fullFor(std::string_view maker) const;  // under the lock
  void sweepSoon();                                           // under the lock
  void sweep();

  mutable std::mutex mutex_;
  std::map<std::string, Kept, std::less<>> sessions_;
  bool sweepSet_ = false;
};

}  // namespace ridgecast::session
