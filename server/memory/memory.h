#pragma once
// The allocator that the server runs with: jemalloc (RIDGECAST_JEMALLOC, on by default), because cameras allocate small things of all sizes
// on whichever thread is free, which the C library's arenas answer with locks and page faults: 24 flying cameras have 1.4 times the
// iterations a second with it (bench cameras). The sanitizers bring their own allocator.

namespace ridgecast::memory {

// Returns what is free to the system. Takes milliseconds. Any thread.
void giveBack();

}  // namespace ridgecast::memory
