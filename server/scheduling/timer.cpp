#include "server/scheduling/timer.h"

#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::scheduling {

struct SteadyTimer::State {
  std::mutex mutex;
  std::condition_variable changed;
  std::multimap<Time, std::function<void()>> calls;
  bool ends = false;
  std::thread thread;

  void run() {
    std::unique_lock lock(mutex);
    while (!ends) {
      if (calls.empty()) {
        changed.wait(lock);
        continue;
      }
      const auto next = calls.begin();
      if (std::chrono::steady_clock::now() < next->first) {
        changed.wait_until(lock, Time(next->first));
        continue;
      }
      const auto call = std::move(next->second);
      calls.erase(next);
      lock.unlock();
      call();
      lock.lock();
    }
  }
};

// At once: later there may be no memory for a thread.
SteadyTimer::SteadyTimer() : state_(std::make_shared<State>()) {
  state_->thread = std::thread([state = state_] { state->run(); });
}

SteadyTimer::~SteadyTimer() {
  std::thread thread;
  {
    const std::lock_guard lock(state_->mutex);
    state_->ends = true;
    thread = std::move(state_->thread);
  }
  state_->changed.notify_all();
  // A call may drop the last owner of the resources, and with them this timer.
  if (thread.get_id() == std::this_thread::get_id())
    thread.detach();
  else
    thread.join();
}

void SteadyTimer::at(Time when, std::function<void()> call) const {
  expects(call != nullptr, "what is timed can be called");
  const std::lock_guard lock(state_->mutex);
  if (state_->ends) return;
  state_->calls.emplace(when, std::move(call));
  state_->changed.notify_all();
}

}  // namespace ridgecast::scheduling
