#pragma once
// What a process has used: this one, or another of the same user by its id.

#include <sys/types.h>

namespace ridgecast::bench {

// Seconds of processor time: unlike the clock on the wall it does not count what other programs do.
double cpuSeconds(pid_t process = 0);
// Resident memory, bytes.
double residentBytes(pid_t process = 0);

}  // namespace ridgecast::bench
