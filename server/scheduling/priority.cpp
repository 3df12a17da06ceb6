#ifdef __linux__
#include <sys/resource.h>
#include <unistd.h>
#endif

#include <algorithm>

#include "server/scheduling/pool.h"

namespace ridgecast::scheduling {

void lowerPriority([[maybe_unused]] int by) {
#ifdef __linux__
  const auto thread = static_cast<id_t>(gettid());  // on Linux a thread has a nice value of its own
  if (by > 0) setpriority(PRIO_PROCESS, thread, std::min(19, getpriority(PRIO_PROCESS, thread) + by));
#endif
}

}  // namespace ridgecast::scheduling
