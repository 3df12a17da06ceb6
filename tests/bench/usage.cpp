#include "tests/bench/usage.h"

#include <unistd.h>

#include <cstdio>
#include <ctime>
#include <stdexcept>
#include <string>

namespace ridgecast::bench {

double cpuSeconds(pid_t process) {
  clockid_t clock{};
  timespec now{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &now) != 0)
    throw std::runtime_error("there is no process " + std::to_string(process));
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double residentBytes(pid_t process) {
  const std::string of = process == 0 ? "self" : std::to_string(process);
  long total = 0, resident = 0;
  if (FILE* f = std::fopen(("/proc/" + of + "/statm").c_str(), "r")) {
    if (std::fscanf(f, "%ld %ld", &total, &resident) != 2) resident = 0;
    std::fclose(f);
  }
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

}  // namespace ridgecast::bench
