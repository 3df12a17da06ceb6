#include "server/memory/memory.h"

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
