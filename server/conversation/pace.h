#pragma once
// How fast one client's iterations may leave: a budget of bytes a second that may be overdrawn by one iteration and is then paid back
// before the next one begins. What a narrow line postpones is detail: an iteration may insert as many vertices as are likely to fit into
// a quarter of a second. Not thread-safe.

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

  // When the next iteration may begin.
  Clock::time_point free() const { return free_; }

  // Vertices that the next iteration may insert. A function of what was sent, not of the clock, so that lock-step stays reproducible.
  std::uint32_t insertions() const {
    if (!limits()) return 0xffffffffu;
    const double room = static_cast<double>(rate_) * kShare / bytesAnInsertion_;
    return static_cast<std::uint32_t>(std::clamp(room, 32.0, 1e6));
  }

  // An iteration of so many bytes has left, which inserted so many vertices.
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
  static constexpr std::chrono::milliseconds kCredit{250};  // what was not used for so long is not saved up

  std::uint64_t rate_ = 0;
  Clock::time_point free_{};
  double bytesAnInsertion_ = 12;
};

}  // namespace ridgecast::conversation
