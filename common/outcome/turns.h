#pragma once
// A computation in turns: a coroutine that yields its cost since the last yield, in a unit of its caller's. Destroying it between two
// turns abandons it. An exception in it is thrown by next(), and ends it.

#include <coroutine>
#include <cstdint>
#include <exception>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast {

class Turns {
 public:
  struct promise_type {
    Turns get_return_object() { return Turns(std::coroutine_handle<promise_type>::from_promise(*this)); }
    std::suspend_always initial_suspend() noexcept { return {}; }
    std::suspend_always final_suspend() noexcept { return {}; }
    std::suspend_always yield_value(std::uint64_t spent) noexcept {
      cost = spent;
      return {};
    }
    void return_void() {}
    void unhandled_exception() { failed = std::current_exception(); }
    std::uint64_t cost = 0;
    std::exception_ptr failed;
  };

  Turns(Turns&& o) noexcept : handle_(std::exchange(o.handle_, nullptr)) {}
  ~Turns() {
    if (handle_) handle_.destroy();
  }

  // Another turn: its cost. Nothing: it is done, with no turns left.
  std::optional<std::uint64_t> next() {
    expects(handle_ && !handle_.done(), "what is done has no turns left");
    handle_.resume();
    if (handle_.promise().failed) std::rethrow_exception(handle_.promise().failed);
    if (handle_.done()) return {};
    return handle_.promise().cost;
  }

 private:
  explicit Turns(std::coroutine_handle<promise_type> handle) : handle_(handle) {}
  std::coroutine_handle<promise_type> handle_;
};

}  // namespace ridgecast
