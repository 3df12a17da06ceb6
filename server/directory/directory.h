#pragma once
// Which sessions a server has, by name, and who may make another.
//
// `default` always exists; the others end after a while without members, and within seconds if nobody has said hello in them; their edits
// are kept, if there is a folder for them. One client may have made at most Limits::maxSessionsPerClient of the live sessions.
//
// A name is reserved before anything is read of its session (reservations.h), and no disk is waited for under a lock: a session whose log
// is slow to open holds up nobody who asks for another.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/directory/reservations.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"

namespace ridgecast::directory {

inline constexpr std::string_view kDefaultName = "default";
inline constexpr std::chrono::milliseconds kUnenteredIdle{5'000};  // of a client's session that nobody has used; at most sessionIdle

// Any thread. Idle sessions end only if a shared_ptr holds this.
class Directory : public std::enable_shared_from_this<Directory> {
 public:
  // Throws std::runtime_error with one sentence when Resources::state cannot be written, or the default session's edits cannot be read.
  // There is no default session while another server has it.
  Directory(std::shared_ptr<const session::Resources> resources, std::shared_ptr<const terrain::Terrain> defaultTerrain,
            std::vector<std::pair<std::string, double>> defaultParameters = {});

  std::shared_ptr<session::Session> find(std::string_view name) const;  // none: nullptr
  // Whether edits are kept of a session of this name.
  bool keeps(const std::string& name) const { return reservations_.hasLog(name); }
  // The right to add the session of a valid name. Null: it lives, is being added, or has ended and is closing its log: find() it, or ask
  // again in a moment. Error: one sentence; another server has it, or its edits cannot be read.
  Outcome<std::unique_ptr<Reservation>> reserve(const std::string& name) const;
  // Adds the session with the edits kept of it, which may take seconds. `maker`: the client, as http::Request::client; empty: the operator,
  // who has no share. Error: full(), or the edits that are kept are of another world.
  Outcome<std::shared_ptr<session::Session>> add(std::unique_ptr<Reservation> reservation, std::shared_ptr<const terrain::Terrain> terrain,
                                                 std::vector<std::pair<std::string, double>> parameters = {}, std::string maker = {},
                                                 wire::ClockMode clock = wire::ClockMode::kRealTime);
  // Likewise. Error: also if the name is taken or invalid.
  Outcome<std::shared_ptr<session::Session>> add(const std::string& name, std::shared_ptr<const terrain::Terrain> terrain,
                                                 std::vector<std::pair<std::string, double>> parameters = {}, std::string maker = {},
                                                 wire::ClockMode clock = wire::ClockMode::kRealTime);
  // A session of the same name, maker and spec with another ground takes the place of this one, which is retired: its members
  // stay until they leave. `prepare` is called with the successor before anybody can find it. Returns false if it has ended already.
  bool replace(const std::shared_ptr<session::Session>& session, std::shared_ptr<const terrain::Terrain> terrain,
               const std::function<void(const session::Session& successor)>& prepare = {});
  // Ends a session for the operator: its name is free, and a client that enters it now must connect again. The caller sends its members
  // away. Null: there is none, or it is the default one.
  std::shared_ptr<session::Session> remove(std::string_view name);
  std::vector<std::shared_ptr<session::Session>> all() const;  // by name
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

  const session::Resources& resources() const { return *resources_; }
  std::uint32_t cameras() const { return quota_->cameras(); }
  std::uint64_t triangles() const { return quota_->triangles(); }  // set aside for the cameras
  std::uint64_t nextCameraId() { return ++lastCameraId_; }
  void startCameraIdsAfter(std::uint64_t last) { expects(lastCameraId_.exchange(last) == 0, "numbers begin before anybody has one"); }

 private:
  std::shared_ptr<const session::Resources> resources_;
  const std::shared_ptr<session::CameraQuota> quota_;
  const Reservations reservations_;
  Outcome<std::shared_ptr<session::Session>> addDefault();
  const struct {
    std::shared_ptr<const terrain::Terrain> terrain;
    std::vector<std::pair<std::string, double>> parameters;
  } default_;
  std::shared_ptr<scheduling::Pool> awaiting_;  // the default session
  std::atomic<std::uint64_t> lastCameraId_{0};
  struct Kept {
    std::shared_ptr<session::Session> session;
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

}  // namespace ridgecast::directory
