#include "common/process/reach.h"

#include <fcntl.h>
#include <linux/landlock.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <utility>

namespace ridgecast::process {
namespace {

// The kernel's, which is longer than that of Debian 12's headers.
struct Handled {
  std::uint64_t files, network;
};
constexpr std::uint64_t kBindsAndConnects = 3;  // LANDLOCK_ACCESS_NET_BIND_TCP | LANDLOCK_ACCESS_NET_CONNECT_TCP
constexpr std::uint64_t kTruncates = 1 << 14;   // LANDLOCK_ACCESS_FS_TRUNCATE
constexpr std::uint64_t kReadFile = LANDLOCK_ACCESS_FS_READ_FILE, kReads = kReadFile | LANDLOCK_ACCESS_FS_READ_DIR;
constexpr std::uint64_t kWrites = LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE |
                                  LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG |
                                  LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK |
                                  LANDLOCK_ACCESS_FS_MAKE_SYM;
constexpr int kTruncatesSince = 3, kConnectsSince = 4;  // versions of Landlock

int version() { return static_cast<int>(syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION)); }

std::uint64_t writesOf(int version) { return kWrites | (version >= kTruncatesSince ? kTruncates : 0); }

bool allow(int rules, const std::filesystem::path& path, std::uint64_t what) {
  const int at = open(path.c_str(), O_PATH | O_CLOEXEC);
  if (at < 0) return true;
  struct stat is {};
  if (fstat(at, &is) == 0 && !S_ISDIR(is.st_mode)) what &= kReadFile;
  const landlock_path_beneath_attr beneath{what, at};
  const bool added = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &beneath, 0) == 0;
  close(at);
  return added;
}

}  // namespace

bool ReachRules::areKept() { return version() > 0; }

Outcome<ReachRules> ReachRules::of(const Reach& reach) {
  const int is = version();
  const Handled handled{kReads | writesOf(is), is >= kConnectsSince ? kBindsAndConnects : 0};
  const std::size_t bytes = is >= kConnectsSince ? sizeof handled : sizeof handled.files;
  ReachRules out(static_cast<int>(syscall(SYS_landlock_create_ruleset, &handled, bytes, 0)));
  bool all = out.file_ >= 0;
  for (const auto& path : reach.reads) all = all && allow(out.file_, path, kReads);
  for (const auto& path : reach.writes) all = all && allow(out.file_, path, handled.files);
  if (!all) return Error{std::string("the kernel does not confine programs (Landlock): ") + std::strerror(errno)};
  return out;
}

ReachRules::ReachRules(ReachRules&& other) noexcept : file_(std::exchange(other.file_, -1)) {}

ReachRules::~ReachRules() {
  if (file_ >= 0) close(file_);
}

bool ReachRules::enter(int descriptor) {
  return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && syscall(SYS_landlock_restrict_self, descriptor, 0) == 0;
}

}  // namespace ridgecast::process
