#include "server/memory/memory.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

namespace ridgecast::memory {
namespace {

constexpr std::uint64_t kUnlimited = std::numeric_limits<std::uint64_t>::max();

// The number in a file; kUnlimited: there is none, as where it says "max".
std::uint64_t numberIn(const std::string& file) {
  std::uint64_t number = 0;
  return std::ifstream(file) >> number ? number : kUnlimited;
}

// The least limit of the process's control group and those above it. In a container only the last may be visible.
std::uint64_t groupLimit() {
  std::uint64_t least = kUnlimited;
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    if (!controllers.empty() && controllers != "memory") continue;
    const std::string root = controllers.empty() ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory";
    const std::string name = controllers.empty() ? "/memory.max" : "/memory.limit_in_bytes";
    for (std::string path = line.substr(second + 1);; path.erase(path.rfind('/'))) {
      least = std::min(least, numberIn(root + path + name));
      if (path.find('/') == std::string::npos) break;
    }
  }
  return least;
}

}  // namespace

std::uint64_t available() {
  const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
  std::uint64_t least = groupLimit();
  if (pages > 0 && page > 0) least = std::min(least, static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page));
  rlimit space;
  if (getrlimit(RLIMIT_AS, &space) == 0 && space.rlim_cur != RLIM_INFINITY) least = std::min<std::uint64_t>(least, space.rlim_cur);
  return least == kUnlimited ? 0 : least;
}

}  // namespace ridgecast::memory

#ifdef RIDGECAST_JEMALLOC

#include <jemalloc/jemalloc.h>

// Read by jemalloc before main: freed memory goes back to the system after a second, even when nothing is allocated any more.
extern "C" {
const char* malloc_conf = "background_thread:true,dirty_decay_ms:1000,muzzy_decay_ms:0";
}

namespace ridgecast::memory {
#define RIDGECAST_TEXT(n) #n
#define RIDGECAST_PURGE(arena) "arena." RIDGECAST_TEXT(arena) ".purge"
void giveBack() { mallctl(RIDGECAST_PURGE(MALLCTL_ARENAS_ALL), nullptr, nullptr, nullptr, 0); }
}  // namespace ridgecast::memory

#elif defined(__GLIBC__)

#include <malloc.h>

namespace ridgecast::memory {
void giveBack() { malloc_trim(0); }
}  // namespace ridgecast::memory

#else

namespace ridgecast::memory {
void giveBack() {}
}  // namespace ridgecast::memory

#endif
