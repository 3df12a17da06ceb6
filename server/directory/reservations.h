#pragma once
// Session names, each held by one maker at a time: taken before anything of the session is read and, if the server keeps edits, held until
// its log is closed, also against other servers on the same folder (edit_log/lock.h). Any thread.
//
//   take() --> kept() says of which world its edits are --> keep() --> the session's Edits, which let go of it last of all

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/outcome/outcome.h"
#include "common/terrain/terrain.h"
#include "server/directory/shared_worlds.h"
#include "server/edit_log/log.h"
#include "server/editing/edits.h"

namespace ridgecast::directory {

inline constexpr std::size_t kMaxKept = 4096;  // logs in Resources::state, of which one client may begin half
inline constexpr int kMaxAside = 9;            // of one name, which are not what the other servers have: NAME.edits.aside1 and so on

class Reservation {
 public:
  const std::string& name() const { return name_; }
  // The world of the edits that are kept of it; null: there are none.
  const edit_log::World* kept() const { return log_ ? &log_->world() : nullptr; }
  // For a session on this terrain: its edits, which may take seconds, or how to begin a log. Error: one sentence; its edits are of another
  // world.
  Outcome<editing::Edits::Kept> keep(const edit_log::World& world, const std::shared_ptr<const terrain::Terrain>& terrain);
  // With a bus: that its world has the name on all servers; `joins`: other servers have the session already.
  void claim(SharedWorlds::Standing standing, bool joins) {
    claimed_ = std::move(standing);
    joins_ = joins;
  }
  const std::optional<SharedWorlds::Standing>& claimed() const { return claimed_; }
  bool joins() const { return joins_; }

 private:
  friend class Reservations;
  // Released last; the lock before the name, so that this server's next maker finds it free.
  struct Held {
    std::shared_ptr<const void> name;
    std::shared_ptr<const edit_log::Lock> lock;  // null: edits are not kept
  };
  std::string name_;
  std::shared_ptr<const Held> held_;
  std::unique_ptr<edit_log::Log> log_;
  std::optional<SharedWorlds::Standing> claimed_;
  bool joins_ = false;
};

class Reservations {
 public:
  // The folder of the logs; empty: edits are not kept. `isShared`: other servers have these sessions, too, each with a folder of its own,
  // for its copies. Throws std::runtime_error with one sentence when it cannot be written, or is another such server's.
  explicit Reservations(std::filesystem::path state, bool isShared = false);

  // Null: it is taken here. Error: one sentence; another server has it, or its log cannot be read.
  Outcome<std::unique_ptr<Reservation>> take(const std::string& name) const;
  // For a name not taken here: whether another server has it.
  bool isElsewhere(const std::string& name) const { return !state_.empty() && edit_log::Lock::isTaken(logOf(name)); }
  // Whether there is a log of this name.
  bool hasLog(const std::string& name) const;

 private:
  struct Names {
    std::mutex mutex;
    std::set<std::string> taken;
  };
  std::filesystem::path logOf(const std::string& name) const { return state_ / (name + ".edits"); }

  const std::filesystem::path state_;
  std::shared_ptr<const edit_log::Lock> folder_;  // of a server among others
  const std::shared_ptr<Names> names_ = std::make_shared<Names>();
};

}  // namespace ridgecast::directory
