#pragma once
// Calls back at a time. One thread for all, started by the first call. Who sets alarms bounds their number (a camera has at most one).

#include <chrono>
#include <functional>
#include <memory>

namespace ridgecast::session {

class Alarm {
 public:
  Alarm();
  ~Alarm();  // alarms not due yet are dropped
  Alarm(const Alarm&) = delete;
  Alarm& operator=(const Alarm&) = delete;

  // `call` runs on the alarm's thread, briefly. Any thread; const, because who shares resources may set alarms.
  void at(std::chrono::steady_clock::time_point when, std::function<void()> call) const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace ridgecast::session
