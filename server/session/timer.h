#pragma once
// The time, and timed calls: the only clock of this room, so that a test can supply its own.

#include <chrono>
#include <functional>
#include <memory>

namespace ridgecast::session {

// Of work in one task, before others run.
inline constexpr std::chrono::milliseconds kTurn{2};

// Any thread; const, because everyone who shares the resources may schedule calls. Callers bound their number.
class Timer {
 public:
  using Time = std::chrono::steady_clock::time_point;

  virtual ~Timer() = default;
  virtual Time now() const = 0;
  // Runs `call` once on the timer's thread; it must be brief. Drops calls that are not due when the timer ends.
  virtual void at(Time when, std::function<void()> call) const = 0;
};

// Real time. One thread for all calls.
class SteadyTimer final : public Timer {
 public:
  SteadyTimer();
  ~SteadyTimer() override;
  SteadyTimer(const SteadyTimer&) = delete;
  SteadyTimer& operator=(const SteadyTimer&) = delete;

  Time now() const override { return std::chrono::steady_clock::now(); }
  void at(Time when, std::function<void()> call) const override;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace ridgecast::session
