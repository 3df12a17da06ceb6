#pragma once
// The server of a simulation: it keeps its edits on a disk that forgets, and with some seeds takes its time, falls at any instant, and
// starts again from what is there. Another may wait beside it on the same folder, and follows it when it stops. Its tasks run on the
// simulation's thread, so that what happens depends on the seed alone.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "common/terrain/terrain.h"
#include "server/directory/directory.h"
#include "server/member/camera_session.h"
#include "server/scheduling/pool.h"
#include "server/session/session.h"
#include "tests/support/forgetful_disk.h"
#include "tests/support/process.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::simulation {

using Random = std::mt19937_64;
using Time = scheduling::Timer::Time;
using Duration = Time::duration;

class Line;

class Server {
 public:
  // The timer goes on while the server does not, and outlives it.
  Server(std::shared_ptr<const terrain::Terrain> terrain, const session::Limits& limits, const testing_support::SimulatedTimer& timer,
         std::uint64_t seed);
  ~Server();

  // Before it starts: many small edits around a place, of the default session.
  void fill(std::uint64_t edits, lattice::Point near);
  // Or the one beside it, where it is up. False: the power went while it started.
  bool start();
  // Everybody's line is lost. `withPower`: it was stopped, and has written what it had, and the one beside it takes its place; otherwise
  // that falls too, and what was not synced may be lost.
  void fall(bool withPower);
  bool isUp() const { return now_.directory != nullptr; }
  bool runs() const { return isUp() && session(); }  // it has the default session
  bool hasOther() const { return beside_.directory != nullptr; }
  void stopOther();
  // The one beside it wants to serve this session for so long.
  void claim(const std::string& session, Duration time);
  bool lostPower() const { return disk_.isOff(); }
  testing_support::ForgetfulDisk& disk() { return disk_; }
  std::filesystem::path folder() const { return folder_ / "state"; }

  const std::shared_ptr<const terrain::Terrain>& terrain() const { return terrain_; }
  // While it runs.
  const std::shared_ptr<directory::Directory>& directory() const { return now_.directory; }
  std::shared_ptr<session::Session> session(std::string_view name = directory::kDefaultName) const { return now_.directory->find(name); }
  // Makes it where it does not live, which takes so long. Null: it is not there yet.
  std::shared_ptr<session::Session> enter(const std::string& name, Duration takes = {});

  // Until it has nothing to do but wait for its disk, unless it is held.
  void settle();
  // Some of what its tasks ask of the terrain finds no memory.
  void starve(Duration time) { starvesUntil_ = timer_.now() + time; }
  // It does nothing until then.
  void hold();
  void release() { isHeld_ = false; }

  void add(const std::shared_ptr<Line>& line, const std::shared_ptr<member::CameraSession>& camera);
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
    std::unique_ptr<scheduling::Executor> executor, writer;
    bool isWriting = false;
    std::shared_ptr<bool> alive;
    std::shared_ptr<directory::Directory> directory;
    std::map<std::string, std::unique_ptr<directory::Reservation>> entering;
  };
  void work(Program& program);
  static void end(Program& program);

  const std::shared_ptr<const terrain::Terrain> terrain_;
  const std::shared_ptr<bool> starves_ = std::make_shared<bool>(false);
  const session::Limits limits_;
  const testing_support::SimulatedTimer& timer_;
  Random random_;  // the disk's own
  testing_support::ScratchFolder folder_;
  testing_support::ForgetfulDisk disk_{random_};
  const Duration diskTime_;
  Program now_, beside_;
  bool isHeld_ = false;
  Time starvesUntil_{};
  std::map<std::string, OpenEdits> openEdits_;  // by session
  std::vector<std::weak_ptr<Line>> lines_;
  std::vector<std::weak_ptr<member::CameraSession>> cameras_;
};

}  // namespace ridgecast::simulation
