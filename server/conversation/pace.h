#pragma once
// Budgets: so much a second. One expense may overdraw a budget; the next waits until that is paid back. Not thread-safe but for
// SharedBudget.

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <mutex>

namespace ridgecast::conversation {

class Budget {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Budget(std::uint64_t perSecond = 0) : rate_(perSecond) {}  // 0: no limit
  void setRate(std::uint64_t perSecond) { rate_ = perSecond; }
  std::uint64_t rate() const { return rate_; }
  bool limits() const { return rate_ != 0; }

  // The earliest time for the next expense.
  Clock::time_point free() const { return free_; }

  void spend(Clock::time_point now, std::uint64_t amount) {
    if (!limits()) return;
    const auto cost = std::chrono::duration<double>(static_cast<double>(amount) / static_cast<double>(rate_));
    free_ = std::max(free_, now - kCredit) + std::chrono::duration_cast<Clock::duration>(cost);
  }

 private:
  static constexpr std::chrono::milliseconds kCredit{250};  // the most unused time that is saved up

  std::uint64_t rate_;
  Clock::time_point free_{};
};

// Spent by all connections of a client. Any thread.
class SharedBudget {
 public:
  explicit SharedBudget(std::uint64_t perSecond) : budget_(perSecond) {}
  Budget::Clock::time_point free() const {
    const std::lock_guard lock(mutex_);
    return budget_.free();
  }
  void spend(Budget::Clock::time_point now, std::uint64_t amount) {
    const std::lock_guard lock(mutex_);
    budget_.spend(now, amount);
  }

 private:
  mutable std::mutex mutex_;
  Budget budget_;
};

// Limits how fast one client's iterations leave, by their bytes. Detail is what a slow connection postpones: an iteration may insert as
// many vertices as probably fit into a quarter of a second.
class Pace : public Budget {
 public:
  // Vertices that the next iteration may insert. Depends on what was sent, not on the clock, so lock-step stays reproducible.
  std::uint32_t insertions() const {
    if (!limits()) return 0xffffffffu;
    const double room = static_cast<double>(rate()) * kShare / bytesAnInsertion_;
    return static_cast<std::uint32_t>(std::clamp(room, 32.0, 1e6));
  }

  // An iteration of `bytes` that inserted `inserted` vertices has left.
  void sent(Clock::time_point now, std::size_t bytes, std::uint32_t inserted) {
    spend(now, bytes);
    if (!limits() || inserted < 32) return;
    const double each = std::clamp(static_cast<double>(bytes) / inserted, 4.0, 64.0);
    bytesAnInsertion_ += (each - bytesAnInsertion_) / 4;
  }

 private:
  static constexpr double kShare = 0.25;  // seconds

  double bytesAnInsertion_ = 12;
};

}  // namespace ridgecast::conversation
