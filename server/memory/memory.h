#pragma once
// The server's allocator: jemalloc (RIDGECAST_JEMALLOC, default on). Cameras allocate small things of all sizes on any free thread, which
// costs the C library's arenas locks and page faults: 24 flying cameras reach 1.4 times the iterations a second with jemalloc (bench
// cameras). Sanitizers bring their own allocator.

#include <cstdint>

namespace ridgecast::memory {

// Bytes that this process may use: the machine's memory, or less by its control groups or RLIMIT_AS. 0: unknown.
std::uint64_t available();

// Returns free memory to the system. Takes milliseconds. Any thread.
void giveBack();

}  // namespace ridgecast::memory
