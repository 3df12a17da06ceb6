#include "server/edit_log/lock.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <string>
#include <system_error>

#include "server/edit_log/tiles.h"

namespace ridgecast::edit_log {
namespace {

namespace fs = std::filesystem;

// Two names of one byte would only keep each other out.
off_t byteOf(const std::string& name) {
  const std::uint64_t hash = hashOfBytes({reinterpret_cast<const std::uint8_t*>(name.data()), name.size()}, 0);
  return static_cast<off_t>(hash >> 2);
}

int openFor(const fs::path& log) {
  return ::open(((log.has_parent_path() ? log.parent_path() : fs::path(".")) / Lock::kFile).c_str(), O_RDWR | O_CLOEXEC);
}

struct flock rangeOf(const std::string& name) {
  struct flock range {};
  range.l_type = F_WRLCK;
  range.l_whence = SEEK_SET;
  range.l_start = byteOf(name);
  range.l_len = 1;
  return range;
}

}  // namespace

Error inUse(const std::string& name) {
  return {"'" + name + "' is in use by another program; stop the server that has it, or wait until its session has ended."};
}

Outcome<void> Lock::prepare(const fs::path& folder) {
  std::error_code failed;
  if (fs::create_directories(folder, failed)) fs::permissions(folder, fs::perms::owner_all, failed);
  if (!fs::is_directory(folder, failed)) return Error{"--state '" + folder.string() + "' is not a folder and cannot be created."};
  const int file = ::open((folder / kFile).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  const bool isWritable = file >= 0 && ::access(folder.c_str(), W_OK | X_OK) == 0;
  const int why = errno;
  if (file >= 0) ::close(file);
  if (isWritable) return {};
  return Error{"--state '" + folder.string() + "' cannot be written: " + std::strerror(why) + "; name a folder that this user may write."};
}

Outcome<std::shared_ptr<const Lock>> Lock::take(fs::path log) {
  const std::string name = log.filename().string();
  const int file = openFor(log);
  const std::shared_ptr<const Lock> lock(new Lock(std::move(log), file));
  struct flock range = rangeOf(name);
  if (lock->file_ < 0 ? errno == ENOENT : fcntl(lock->file_, F_OFD_SETLK, &range) == 0) return lock;
  if (lock->file_ >= 0 && (errno == EAGAIN || errno == EACCES)) return inUse(name);
  return Error{"Cannot lock '" + name + "' in " + kFile + ": " + std::strerror(errno) + "."};
}

bool Lock::isTaken(const fs::path& log) {
  const int file = openFor(log);
  if (file < 0) return false;
  struct flock range = rangeOf(log.filename().string());
  const bool isTaken = fcntl(file, F_OFD_GETLK, &range) == 0 && range.l_type != F_UNLCK;
  ::close(file);
  return isTaken;
}

Lock::~Lock() {
  if (file_ >= 0) ::close(file_);
}

}  // namespace ridgecast::edit_log
