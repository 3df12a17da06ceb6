#pragma once
// The last values of a statistic, for plots.

#include <array>
#include <cstddef>
#include <cstdint>

namespace ridgecast::viewer {

class History {
 public:
  static constexpr std::size_t kLength = 240;
  void add(double value) {
    values_[next_] = static_cast<float>(value);
    next_ = (next_ + 1) % kLength;
    count_ = count_ < kLength ? count_ + 1 : kLength;
  }
  std::size_t size() const { return count_; }
  // 0 is the oldest.
  float at(std::size_t k) const { return values_[(next_ + kLength - count_ + k) % kLength]; }
  float newest() const { return count_ ? at(count_ - 1) : 0; }
  float most() const {
    float out = 0;
    for (std::size_t k = 0; k < count_; ++k) out = out < at(k) ? at(k) : out;
    return out;
  }

 private:
  std::array<float, kLength> values_{};
  std::size_t next_ = 0, count_ = 0;
};

// Progress of a mesh being built: how much fewer insertions and removals there are than at the peak since it was last at rest. Never
// decreases before it rests.
class Building {
 public:
  void iterated(std::uint64_t changes, bool settled) {
    most_ = settled ? 0 : most_ < changes ? changes : most_;
    const double share = settled ? 1 : most_ == 0 ? 0 : 1 - static_cast<double>(changes) / static_cast<double>(most_);
    share_ = settled || atRest_ ? share : share_ < share ? share : share_;
    atRest_ = settled;
  }
  double share() const { return share_; }

 private:
  std::uint64_t most_ = 0;
  double share_ = 0;
  bool atRest_ = true;
};

}  // namespace ridgecast::viewer
