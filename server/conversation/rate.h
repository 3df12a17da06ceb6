#pragma once
// Limits on the rate and size of iterations. A Budget grants an amount per second; one expense may overdraw it, and the next waits until
// that is paid back. Not thread-safe, except SharedBudget.

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>

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
  // Credit is full: a new budget could spend no more.
  bool isFull(Clock::time_point now) const { return free_ + kCredit <= now; }

  void spend(Clock::time_point now, std::uint64_t amount) {
    if (!limits()) return;
    const auto cost = std::chrono::duration<double>(static_cast<double>(amount) / static_cast<double>(rate_));
    free_ = std::max(free_, now - kCredit) + std::chrono::duration_cast<Clock::duration>(cost);
  }

 private:
  static constexpr std::chrono::milliseconds kCredit{250};  // at most this much unused time is saved up

  std::uint64_t rate_;
  Clock::time_point free_{};
};

// Spent by all connections of a client, also on other servers. Any thread.
class SharedBudget {
 public:
  explicit SharedBudget(std::uint64_t perSecond) : budget_(perSecond) {}
  Budget::Clock::time_point free() const {
    const std::lock_guard lock(mutex_);
    return budget_.free();
  }
  bool isFull(Budget::Clock::time_point now) const {
    const std::lock_guard lock(mutex_);
    return budget_.isFull(now);
  }
  void spend(Budget::Clock::time_point now, std::uint64_t amount) {
    const std::lock_guard lock(mutex_);
    budget_.spend(now, amount);
    spent_ += amount;
  }
  // Spent on another server.
  void charge(Budget::Clock::time_point now, std::uint64_t amount) {
    const std::lock_guard lock(mutex_);
    budget_.spend(now, amount);
  }
  // Whether spend() has spent what matters since takeSpent(): a hundredth of a second's amount.
  bool hasSpent() const {
    const std::lock_guard lock(mutex_);
    return hasSpentNow();
  }
  // What it has, if that matters.
  std::uint64_t takeSpent() {
    const std::lock_guard lock(mutex_);
    return hasSpentNow() ? std::exchange(spent_, 0) : 0;
  }

 private:
  bool hasSpentNow() const { return spent_ > budget_.rate() / 100; }  // under the lock

  mutable std::mutex mutex_;
  Budget budget_;
  std::uint64_t spent_ = 0;
};

// Limits how fast one client's iterations leave, by their bytes. A slow connection postpones detail: an iteration may insert as many
// vertices as probably fit into a quarter of a second.
class ByteRate : public Budget {
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

// Limits insertions so that iterations keep pace with poses, whatever else loads the machine (after Chiu and Jain 1989): +1/8 when on time;
// when late, scaled by target time / actual time, to at most half; doubled at each iteration while no poses come. The first pose, or one
// after a rest, is not timed: seen from one pose, a new mesh comes out the same each time. Fewer vertices also touch fewer leaves, which
// saves extraction and coding; without this, a late camera has flown farther, has more to do and is later still. A late iteration that
// inserted at most kMin changes nothing: detail is not what takes the time.
class InsertionRate {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::uint32_t kMin = 16, kMax = 1u << 20;

  std::uint32_t insertions() const { return insertions_; }

  // A pose has come.
  void pose(Time now) {
    const double gap = std::max(0.0, std::chrono::duration<double>(now - last_).count());
    last_ = now;
    if (gap > kSlowest) return;
    interval_ += (gap - interval_) / 8;
    if (!waitsSince_) waitsSince_ = now;
  }
  // An iteration for the newest pose begins.
  void begin() { answers_ = std::exchange(waitsSince_, std::nullopt); }
  // It has left.
  void sent(Time now, std::uint32_t inserted) {
    const double took = answers_ ? std::chrono::duration<double>(now - *answers_).count() : 0,
                 time = kShare * std::max(interval_, kFastest);
    const bool rests = !answers_ && std::chrono::duration<double>(now - last_).count() > kSlowest;
    if (took <= time)
      insertions_ = std::min(kMax, insertions_ + (rests ? insertions_ : std::max(insertions_ / 8, 2u)));
    else if (inserted > kMin)
      insertions_ = std::max(kMin, static_cast<std::uint32_t>(std::min(insertions_, inserted) * std::clamp(time / took, 0.0625, 0.5)));
  }

 private:
  static constexpr double kShare = 0.75;                    // of the time between poses
  static constexpr double kFastest = 0.05, kSlowest = 0.3;  // seconds between poses; those farther apart do not count

  std::uint32_t insertions_ = kMax;
  double interval_ = 0.1;
  Time last_{};
  std::optional<Time> waitsSince_;  // the first pose since the last iteration began, but for one after a rest
  std::optional<Time> answers_;     // the one that the current iteration answers
};

}  // namespace ridgecast::conversation
