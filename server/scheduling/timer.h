#pragma once
// The time, and timed calls. A test can supply its own.

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>

namespace ridgecast::scheduling {

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

// A call that an object makes to itself, under its own lock, unless it is gone by then; at most one waits at a time. Under that lock.
class Alarm {
 public:
  // `owner` has this alarm, `mutex` and `call`. Nothing, if one waits already.
  template <class Owner, class Call>
  void set(const Timer& timer, Timer::Time when, std::weak_ptr<Owner> owner, std::mutex& mutex, Call Owner::*call) {
    if (std::exchange(isSet_, true)) return;
    timer.at(when, [this, owner = std::move(owner), &mutex, call] {
      const auto self = owner.lock();
      if (!self) return;
      const std::lock_guard lock(mutex);
      isSet_ = false;
      std::invoke(call, *self);
    });
  }

 private:
  bool isSet_ = false;
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

}  // namespace ridgecast::scheduling
