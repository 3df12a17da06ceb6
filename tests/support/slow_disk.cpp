// Preloaded into a program (LD_PRELOAD): each fsync and fdatasync takes SLOW_DISK_MS more.
#include <dlfcn.h>

#include <chrono>
#include <cstdlib>
#include <thread>

namespace {

int late(const char* call, int file) {
  const char* const given = std::getenv("SLOW_DISK_MS");
  std::this_thread::sleep_for(std::chrono::milliseconds(given ? std::atoi(given) : 0));
  return reinterpret_cast<int (*)(int)>(dlsym(RTLD_NEXT, call))(file);
}

}  // namespace

extern "C" int fsync(int file) { return late("fsync", file); }
extern "C" int fdatasync(int file) { return late("fdatasync", file); }
