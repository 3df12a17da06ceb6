#ifdef __linux__
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>
#endif

#include <algorithm>

#include "server/scheduling/pool.h"

namespace ridgecast::scheduling {

void lowerPriority([[maybe_unused]] int by) {
#ifdef __linux__
  const auto thread = static_cast<id_t>(gettid());  // on Linux a thread has a nice value of its own
  const sched_param none{};
  if (by >= kIdle && sched_setscheduler(0, SCHED_IDLE, &none) == 0) return;
  if (by > 0) setpriority(PRIO_PROCESS, thread, std::min(19, getpriority(PRIO_PROCESS, thread) + by));
#endif
}

}  // namespace ridgecast::scheduling
