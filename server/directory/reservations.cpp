#include "server/directory/reservations.h"

#include <stdexcept>
#include <system_error>
#include <utility>

#include "common/outcome/contract.h"
#include "common/wire/wire.h"
#include "server/edit_log/clients.h"
#include "server/logging/logging.h"

namespace ridgecast::directory {

namespace {

namespace fs = std::filesystem;

std::string folderOf(const fs::path& log) { return "in '" + log.parent_path().string() + "': "; }

// The operator is told where the file is, clients are not.
Error told(const fs::path& log, Error e) {
  logging::error(folderOf(log) + e.message);
  return e;
}

Outcome<std::unique_ptr<edit_store::Store>> beginLog(std::shared_ptr<const edit_log::Lock> lock, const edit_log::World& world,
                                                     std::string_view client) {
  const fs::path file = lock->log();
  auto log = edit_log::createFor(client, std::move(lock), world, kMaxKept);
  if (!log) return told(file, log.error());
  return std::unique_ptr<edit_store::Store>(std::move(*log));
}

fs::path asideOf(const fs::path& log, int number) { return log.string() + ".aside" + std::to_string(number); }

// A log that is closed. SQLite may have left its journal, which belongs to it.
void setAside(const fs::path& log) {
  std::error_code failed;
  int number = 1;
  while (number < kMaxAside && fs::exists(asideOf(log, number), failed)) ++number;
  if (!fs::exists(log, failed)) return;
  for (const char* const part : {"", "-wal", "-shm"})
    if (fs::exists(log.string() + part, failed)) fs::rename(log.string() + part, asideOf(log, number).string() + part, failed);
  if (failed) return logging::error(folderOf(log) + "'" + log.filename().string() + "' cannot be set aside: " + failed.message() + ".");
  logging::warning(folderOf(log) + "'" + log.filename().string() + "' is now '" + asideOf(log, number).filename().string() +
                   "': it is not what the other servers have; delete it when nobody needs it.");
}

}  // namespace

Reservations::Reservations(fs::path state, bool isShared) : state_(std::move(state)) {
  if (state_.empty()) return;
  edit_log::Lock::prepare(state_).value();
  if (!isShared) return;
  auto folder = edit_log::Lock::take(state_ / "this folder");
  if (!folder)
    throw std::runtime_error("--state '" + state_.string() +
                             "' is another server's; with --shared each server has a folder of its own, for its copies of the edits.");
  folder_ = std::move(*folder);
}

bool Reservations::hasLog(const std::string& name) const {
  std::error_code unknown;
  return !state_.empty() && fs::exists(logOf(name), unknown);
}

Outcome<std::unique_ptr<Reservation>> Reservations::take(const std::string& name) const {
  expects(wire::sessionNameIsValid(name), "a name that becomes a file's is valid");
  {
    const std::lock_guard lock(names_->mutex);
    if (!names_->taken.insert(name).second) return std::unique_ptr<Reservation>();
  }
  auto reservation = std::make_unique<Reservation>();
  reservation->name_ = name;
  Reservation::Held held;
  held.name = std::shared_ptr<const void>(nullptr, [names = names_, name](const void*) {
    const std::lock_guard lock(names->mutex);
    names->taken.erase(name);
  });
  if (!state_.empty()) {
    auto lock = edit_log::Lock::take(logOf(name));
    if (!lock) return lock.error();
    held.lock = std::move(*lock);
    std::error_code unknown;
    if (fs::exists(asideOf(logOf(name), kMaxAside), unknown))
      return told(logOf(name),
                  Error{"The session '" + name + "' does not begin here: " + std::to_string(kMaxAside) +
                        " logs of it were set aside, as they were not what the other servers have; its operator must find out why, "
                        "and move them away."});
    auto log = edit_log::Log::open(held.lock);
    if (!log) return told(logOf(name), log.error());
    reservation->log_ = std::move(*log);
  }
  reservation->held_ = std::make_shared<const Reservation::Held>(std::move(held));
  return reservation;
}

Outcome<editing::Edits::Kept> Reservation::keep(const edit_log::World& world, const std::shared_ptr<const terrain::Terrain>& terrain) {
  expects(held_ && terrain, "a name is held until its session has it");
  editing::Edits::Kept kept;
  if (!held_->lock) return kept;  // its name is free as soon as it lives
  kept.held = held_;
  kept.folder = folderOf(held_->lock->log());
  kept.setAside = [log = held_->lock->log()] { setAside(log); };
  if (!log_) {
    kept.makeStore = [lock = held_->lock, world](std::string_view client) { return beginLog(lock, world, client); };
    return kept;
  }
  const edit_log::World& its = log_->world();
  if (its.terrain != world.terrain || its.seed != world.seed || its.parameters != world.parameters)
    return Error{"The session '" + name_ + "' has edits of another world, " + its.terrain + " with seed " + std::to_string(its.seed) +
                 "; join it without naming a terrain, or choose another name."};
  auto history = edit_log::historyOf(*log_, terrain);
  if (!history) return told(held_->lock->log(), history.error());
  kept.store = std::move(log_);
  kept.history = std::move(*history);
  return kept;
}

}  // namespace ridgecast::directory
