#pragma once
// Limits how fast one client's iterations leave: a budget of bytes a second. One iteration may overdraw it; the next waits until that is
// paid back. Detail is what a slow connection postpones: an iteration may insert as many vertices as probably fit into a quarter of a
// second. Not thread-safe.

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace ridgecast::conversation {

class Pace {
 public:
  using Clock = std::chrono::steady_clock;

  // 0: no limit.
  void setRate(std::uint64_t bytesPerSecond) { rate_ = bytesPerSecond; }
  bool limits() const { return rate_ != 0; }

  // The earliest time for the next iteration.
  Clock::time_point free() const { return free_; }

  // Vertices that the next iteration may insert. Depends on what was sent, not on the clock, so lock-step stays reproducible.
  std::uint32_t insertions() const {
    if (!limits()) return 0xffffffffu;
    const double room = static_cast<double>(rate_) * kShare / bytesAnInsertion_;
    return static_cast<std::uint32_t>(std::clamp(room, 32.0, 1e6));
  }

  // An iteration of `bytes` that inserted `inserted` vertices has left.
  void sent(Clock::time_point now, std::size_t bytes, std::uint32_t inserted) {
    if (!limits()) return;
    const auto cost = std::chrono::duration<double>(static_cast<double>(bytes) / static_cast<double>(rate_));
    free_ = std::max(free_, now - kCredit) + std::chrono::duration_cast<Clock::duration>(cost);
    if (inserted < 32) return;
    const double each = std::clamp(static_cast<double>(bytes) / inserted, 4.0, 64.0);
    bytesAnInsertion_ += (each - bytesAnInsertion_) / 4;
  }

 private:
  static constexpr double kShare = 0.25;                    // seconds
  static constexpr std::chrono::milliseconds kCredit{250};  // the most unused time that is saved up

  std::uint64_t rate_ = 0;
  Clock::time_point free_{};
  double bytesAnInsertion_ = 12;
};

}  // namespace ridgecast::conversation
