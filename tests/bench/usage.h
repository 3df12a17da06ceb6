#pragma once
// What this process has used.

namespace ridgecast::bench {

// Seconds of processor time this process has used: unlike the clock on the wall it does not count what other programs do.
double cpuSeconds();
// Resident memory of this process, bytes.
double residentBytes();

}  // namespace ridgecast::bench
