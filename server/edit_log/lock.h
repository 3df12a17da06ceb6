#pragma once
// Which program owns a session's edits: a lock on the name of their log, taken before the log exists and held until it is closed. It
// belongs to an open file of its own (fcntl(2), open file description locks), so that nothing else that this program opens or closes can
// release it, and it ends with the program, however that ends. Any thread.
//
// A server's folder of logs has one lock file, in which each name locks a byte of its own. In a folder without one nothing is locked: no
// server uses it, and SQLite's own locks on a log remain.

#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "common/outcome/outcome.h"

namespace ridgecast::edit_log {

// One sentence about a log that another program has.
Error inUse(const std::string& name);

class Lock {
 public:
  static constexpr char kFile[] = "edits.lock";

  // Makes the folder, readable by its owner alone, and its lock file, where there are none. Error: one sentence; it cannot be written.
  static Outcome<void> prepare(const std::filesystem::path& folder);
  // Error: one sentence; it is taken, by this program or another.
  static Outcome<std::shared_ptr<const Lock>> take(std::filesystem::path log);
  // Whether it is taken, by this program or another.
  static bool isTaken(const std::filesystem::path& log);
  ~Lock();
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

  const std::filesystem::path& log() const { return log_; }

 private:
  Lock(std::filesystem::path log, int file) : log_(std::move(log)), file_(file) {}
  std::filesystem::path log_;
  int file_;  // -1: there is no lock file
};

}  // namespace ridgecast::edit_log
