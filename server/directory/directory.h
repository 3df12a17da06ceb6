#pragma once
// Which sessions a server has, by name, and who may make another.
//
// `default` always exists; the others end after a while without members, and within seconds if nobody has said hello in them; their edits
// are kept, if there is a folder for them. One client may have made at most Limits::maxSessionsPerClient of the live sessions.
//
// A name is reserved before anything is read of its session (reservations.h), and no disk is waited for under a lock: a session whose log
// is slow to open holds up nobody who asks for another.
//
// With a bus (Resources::bus) the sessions of all its servers are one directory. A name is one world on all of them (shared_worlds.h), each
// server makes the sessions that its clients ask for, and once a second it says which it has (records.h: ServerStatus) and hears the same
// of the others. Limits of sessions, of members and of what clients may spend count all servers: this one exactly, the others as they were
// a second ago. While the engine is away the sessions that are here go on, others cannot be made, and the figures of others stay.

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
#include "server/directory/records.h"
#include "server/directory/reservations.h"
#include "server/directory/shared_worlds.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"

namespace ridgecast::directory {

inline constexpr std::string_view kDefaultName = "default";
inline constexpr std::chrono::milliseconds kUnenteredIdle{5'000};  // of a client's session that nobody has used; at most sessionIdle
inline constexpr std::chrono::milliseconds kTellEvery{1'000};      // interval of what servers say of themselves
inline constexpr std::chrono::milliseconds kServerLife{3'000};     // of what a server said last

// Any thread. Idle sessions end only if a shared_ptr holds this.
class Directory : public std::enable_shared_from_this<Directory> {
 public:
  // Throws std::runtime_error with one sentence when Resources::state cannot be written, or the default session's edits cannot be read.
  // There is no default session while another server on the same folder has it; with a bus, that throws too: each server has its own.
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
  // With a bus, for a reservation that was claimed, with the terrain and clock of claimed().
  Outcome<std::shared_ptr<session::Session>> add(std::unique_ptr<Reservation> reservation, std::shared_ptr<const terrain::Terrain> terrain,
                                                 std::vector<std::pair<std::string, double>> parameters = {}, std::string maker = {},
                                                 wire::ClockMode clock = wire::ClockMode::kRealTime);
  // Likewise, without a bus. Error: also if the name is taken or invalid.
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
  // If another server has the default session, takes it as soon as that server releases it.
  void awaitDefault();

  // ---- with other servers ----

  bool isShared() const { return resources_->bus->server() != 0; }
  const SharedWorlds& worlds() const { return *worlds_; }
  // A new one.
  World propose(session::WorldSpec spec, const terrain::Terrain& terrain, std::string maker);
  static World defaultWorld(const terrain::Terrain& terrain, std::vector<std::pair<std::string, double>> parameters);
  // Before the directory is made: `done` once the default session is the same world on all servers. Error: one sentence; it is another
  // world on them, or the engine is away.
  static void claimDefault(const session::Resources& resources, const terrain::Terrain& terrain,
                           std::vector<std::pair<std::string, double>> parameters, std::function<void(Outcome<void>)> done);

  // Of this server, for the others. The functions are called by any thread, and do not call back.
  struct Host {
    std::string url;  // as people reach it
    std::function<double()> load;
    std::function<std::string(const session::Session&)> entry;  // ServerStatus::Session::entry
    // Ends streams of a session for the operator: this camera's, or all.
    std::function<void(const session::Session&, std::optional<std::uint64_t> camera)> remove;
    std::function<void(const session::Session&)> sendAway;  // its members connect again
    std::function<void()> leave;                            // the other servers' default session is another world
  };
  // Tells and hears from now on, if there is a bus.
  void join(Host host);
  ServerStatus self() const;  // without sessions; after join()
  // The other servers, as of a second ago.
  std::shared_ptr<const std::vector<ServerStatus>> others() const;
  // Whose session of this name is on another server; null: none is. As of a second ago.
  static const ServerStatus::Session* find(const std::vector<ServerStatus>& servers, std::string_view name);
  // The other server that has this session and this camera's number; null: none.
  std::shared_ptr<const ServerStatus> serverOf(const std::string& session, std::uint64_t camera) const;
  // Ends a session that is not here, as remove() does; the others follow within two seconds. False: none is known.
  bool removeElsewhere(const std::string& name);
  // Asks serverOf(this camera) to send it away. False: there is none.
  bool removeElsewhere(const std::string& name, std::uint64_t camera);

  const session::Resources& resources() const { return *resources_; }
  std::uint32_t cameras() const { return quota_->cameras(); }
  std::uint64_t triangles() const { return quota_->triangles(); }  // set aside for the cameras
  // Unique on all servers: the bus's number of this server in the upper bits, below 2^52.
  std::uint64_t nextCameraId() {
    const std::uint64_t number = ++lastCameraId_;
    expects(!isShared() || number <= 0xffffffff, "a server's cameras have numbers of 32 bits");
    return std::uint64_t{resources_->bus->server()} << 32 | number;
  }
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
  const std::shared_ptr<SharedWorlds> worlds_;
  std::shared_ptr<scheduling::Pool> awaiting_;  // the default session
  std::atomic<std::uint64_t> lastCameraId_{0};
  struct Kept {
    std::shared_ptr<session::Session> session;
    std::string maker;
    // It had no members at `idleSince`, and nobody has used it since.
    std::uint64_t uses = 0;
    std::optional<std::chrono::steady_clock::time_point> idleSince;
    // With a bus: its record, and whether its world is kept for its edits.
    World world{};
    std::uint64_t epoch = 0;
    bool isKept = false;
  };
  using Sessions = std::map<std::string, Kept, std::less<>>;
  std::optional<Full> fullFor(std::string_view maker) const;  // under the lock
  void letGo(const std::string& name);                        // of a session that cannot go on here; its members must connect again
  void sweepSoon();                                           // under the lock
  void sweep();

  void tick();
  void tellOfItself();
  void hearOfServers();
  void heardOfServers(const std::map<std::string, bus::Record>& records);
  void hearOfEnded();
  void tellSpent();
  void renew(const std::string& name, const Kept& kept);
  void renewed(const std::string& name, const session::Session* session, const SharedWorlds::Standing& stands);
  session::Session::Claim claimOf(const std::string& name, const World& world) const;
  void keepWorld(const std::string& name, const Kept& kept);
  std::shared_ptr<session::Session> take(Sessions::iterator it);  // out of sessions_, and retires it; under the lock

  mutable std::mutex mutex_;
  Sessions sessions_;
  bool sweepSet_ = false;
  // With a bus.
  Host host_;  // constant after join()
  std::shared_ptr<scheduling::Pool> hearing_;
  std::vector<bus::Subscription> heard_;
  std::uint64_t epoch_ = 0, ticks_ = 0;
  std::shared_ptr<const std::vector<ServerStatus>> others_ = std::make_shared<const std::vector<ServerStatus>>();
};

}  // namespace ridgecast::directory
