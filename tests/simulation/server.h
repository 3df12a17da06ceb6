#pragma once
// The server of a simulation: it keeps its edits on a disk that forgets, and with some seeds takes its time, falls at any instant, and
// starts again from what is there. Another may wait beside it on the same folder, and follows it when it stops. Its tasks run on the
// simulation's thread, so that what happens depends on the seed alone.
//
// Or one of several servers of a world (cluster.h): then it has an engine instead of one beside it, and its own copies on the disk.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/terrain/terrain.h"
#include "server/directory/directory.h"
#include "server/http/routes.h"
#include "server/member/camera_session.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "tests/support/forgetful_disk.h"
#include "tests/support/process.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::simulation {

using Random = std::mt19937_64;
using Time = scheduling::Timer::Time;
using Duration = Time::duration;

class Line;

class Server {
 public:
  // What it shares with other servers, which outlives it.
  struct Shared {
    testing_support::SimulatedEngine& engine;
    testing_support::ForgetfulDisk& disk;
  };
  // The timer goes on while the server does not, and outlives it.
  Server(std::shared_ptr<const terrain::Terrain> terrain, const session::Limits& limits, const testing_support::SimulatedTimer& timer,
         std::uint64_t seed, std::optional<Shared> shared = {});
  ~Server();

  // Before it starts: many small edits around a place, of the default session.
  void fill(std::uint64_t edits, lattice::Point near);
  // Or the one beside it, where it is up. False: the power went while it started. One of several begins later, once the engine answers, or
  // not at all: start it again until it is up.
  bool start();
  // Everybody's line is lost. `withPower`: it was stopped, and has written what it had, and the one beside it takes its place; otherwise
  // that falls too, and what was not synced may be lost. One of several loses its process alone.
  void fall(bool withPower);
  // Its members are sent to other servers, and nobody can enter.
  void drain();
  bool isUp() const { return now_.directory != nullptr; }
  bool runs() const { return isUp() && session(); }  // it has the default session
  bool hasOther() const { return beside_.directory != nullptr; }
  void stopOther();
  // The one beside it wants to serve this session for so long.
  void claim(const std::string& session, Duration time);
  bool lostPower() const { return disk_.isOff(); }
  bool isShared() const { return shared_.has_value(); }
  bool takesMembers() const { return runs() && takesMembers_; }
  bool isStarting() const { return !isUp() && now_.executor; }
  const bus::Bus* bus() const { return now_.bus.get(); }  // null: it is down, or alone
  testing_support::ForgetfulDisk& disk() { return disk_; }
  std::filesystem::path folder() const { return folder_ / "state"; }

  const std::shared_ptr<const terrain::Terrain>& terrain() const { return terrain_; }
  // While it runs.
  const std::shared_ptr<directory::Directory>& directory() const { return now_.directory; }
  std::shared_ptr<session::Session> session(std::string_view name = directory::kDefaultName) const { return now_.directory->find(name); }
  // Makes it where it does not live, which takes so long. Null: it is not there yet.
  std::shared_ptr<session::Session> enter(const std::string& name, Duration takes = {});
  // As a stream does, where servers share the session; one of this seed, if it is not given. `then` is called once, perhaps at once. Null:
  // it was refused.
  void join(const std::string& name, const std::string& client, std::function<void(std::shared_ptr<session::Session>)> then,
            std::uint32_t seed = 0);

  static constexpr std::chrono::milliseconds kCeasing{500};  // of one of several, before it may start again

  // Until it has nothing to do but wait for its disk, unless it is held.
  void settle();
  // Some of what its tasks ask of the terrain finds no memory.
  void starve(Duration time) { starvesUntil_ = timer_.now() + time; }
  // It does nothing until then.
  void hold();
  void release() { isHeld_ = false; }

  void add(const std::shared_ptr<Line>& line, const std::shared_ptr<member::CameraSession>& camera);
  // For so long, or until it falls.
  void keep(std::shared_ptr<void> what, Duration time);
  bool hasCameras() const;  // as objects: memory that was not given back
  // Edits that have arrived and have no answer. Those with one key are one.
  struct OpenEdits {
    std::int64_t edits = 0;
    std::map<std::string, int> keys;  // whole ones, as in the log
    void open(const std::string& key) {
      if (key.empty() || keys[key]++ == 0) ++edits;
    }
    void close(const std::string& key) {
      if (key.empty() || --keys[key] == 0) --edits;
    }
  };
  OpenEdits& openEdits(const std::string& session) { return openEdits_[session]; }

 private:
  class Clock;
  class Starving;
  struct Program {
    std::shared_ptr<const session::Resources> resources;  // for calls of its timer
    std::unique_ptr<scheduling::Executor> executor, writer;
    bool isWriting = false;
    std::shared_ptr<bool> alive, isTimed;  // isTimed: what it waits for still comes
    std::shared_ptr<bus::Bus> bus;         // of one of several
    std::shared_ptr<directory::Directory> directory;
    std::map<std::string, std::unique_ptr<directory::Reservation>> entering;
  };
  void cease();
  std::shared_ptr<session::Resources> begin(Program& program);
  void work(Program& program);
  static void end(Program& program);
  void startShared();
  void serve(const std::shared_ptr<session::Resources>& resources);
  void poll(std::uint64_t joining);
  std::shared_ptr<session::Session> sessionOf(const http::Reply& reply) const;  // null: it is a refusal

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<bool> starves_ = std::make_shared<bool>(false);
  const session::Limits limits_;
  const testing_support::SimulatedTimer& timer_;
  Random random_;  // the disk's own
  testing_support::ScratchFolder folder_;
  const std::optional<Shared> shared_;
  const std::unique_ptr<testing_support::ForgetfulDisk> ownDisk_;
  testing_support::ForgetfulDisk& disk_;
  const Duration diskTime_;
  Program now_, beside_;
  bool isHeld_ = false;
  Time starvesUntil_{};
  std::map<std::string, OpenEdits> openEdits_;  // by session
  std::vector<std::weak_ptr<Line>> lines_;
  std::vector<std::weak_ptr<member::CameraSession>> cameras_;
  // Of one of several.
  struct Joining {
    http::DeferredResponse work;
    std::function<void(std::shared_ptr<session::Session>)> then;
  };
  std::map<std::uint64_t, Joining> joining_;
  std::uint64_t lastJoining_ = 0;
  std::set<std::shared_ptr<void>> kept_;
  bool takesMembers_ = true;
  std::vector<std::shared_ptr<Program>> gone_;
};

}  // namespace ridgecast::simulation
