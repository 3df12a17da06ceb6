#pragma once
// Binary arithmetic coding with adaptive probabilities, without carries (as in lpaq, Mahoney 2007): predictable bits cost almost nothing.
// Encoder and decoder have the same interface, so one piece of code describes a format for both directions: a value goes in, the coded
// value comes out.
//
// A probability has 16 bits and learns faster while it is young. An interval [low, high] of 32 bits is split in the ratio of the
// probability; equal top bytes are shifted out. The code ends with the fewest bytes whose value, followed by zeros, lies in the last
// interval. A decoder reads zeros beyond the end, and knows afterwards how many bytes there must have been.

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace ridgecast::points {

// The probability that the next bit is 1, in 1/65536, and the number of bits seen.
struct Probability {
  std::uint16_t one = 32768;
  std::uint16_t seen = 0;

  constexpr Probability() = default;
  // A first guess in 1/256, with the weight of two bits seen.
  constexpr explicit Probability(unsigned of256) : one(static_cast<std::uint16_t>(of256 << 8)), seen(2) {}

  void learn(bool bit) {
    constexpr std::uint16_t kRate[] = {32768, 21845, 16384, 13107, 10922, 9362, 8192, 7281, 6553, 5957,
                                       5461,  5041,  4681,  4369,  4096,  3855, 3640, 3449, 3276};
    constexpr std::uint16_t kOldest = 18;
    const std::int32_t target = bit ? 65535 - 64 : 64;
    one = static_cast<std::uint16_t>(one + (((target - one) * kRate[seen]) >> 16));
    if (seen < kOldest) ++seen;
  }
};

// Bytes needed to name a value in [low, high], followed by zero bytes.
constexpr int tailBytes(std::uint32_t low, std::uint32_t high) {
  for (int bytes = 0; bytes < 4; ++bytes) {
    const std::uint64_t rest = 0xffffffffull >> (8 * bytes);
    if (((low + rest) & ~rest) <= high) return bytes;
  }
  return 4;
}

class RangeEncoder {
 public:
  static constexpr bool kDecodes = false;
  explicit RangeEncoder(std::vector<std::uint8_t>& out) : out_(out) {}

  bool bit(Probability& p, bool value) {
    const std::uint32_t middle = low_ + ((high_ - low_) >> 16) * p.one;
    split(middle, value);
    p.learn(value);
    return value;
  }
  bool even(bool value) {  // a bit without a model
    split(low_ + ((high_ - low_) >> 1), value);
    return value;
  }
  bool failed() const { return false; }

  void finish() {
    const int bytes = tailBytes(low_, high_);
    const std::uint64_t rest = 0xffffffffull >> (8 * bytes), value = (low_ + rest) & ~rest;
    for (int k = 0; k < bytes; ++k) out_.push_back(static_cast<std::uint8_t>(value >> (24 - 8 * k)));
  }

 private:
  void split(std::uint32_t middle, bool value) {
    if (value)
      high_ = middle;
    else
      low_ = middle + 1;
    for (; ((low_ ^ high_) >> 24) == 0; low_ <<= 8, high_ = high_ << 8 | 255) out_.push_back(static_cast<std::uint8_t>(high_ >> 24));
  }

  std::vector<std::uint8_t>& out_;
  std::uint32_t low_ = 0, high_ = 0xffffffffu;
};

class RangeDecoder {
 public:
  static constexpr bool kDecodes = true;
  explicit RangeDecoder(std::span<const std::uint8_t> bytes) : bytes_(bytes) {
    for (int k = 0; k < 4; ++k) value_ = value_ << 8 | next();
  }

  bool bit(Probability& p, bool = false) {
    const bool value = split(low_ + ((high_ - low_) >> 16) * p.one);
    p.learn(value);
    return value;
  }
  bool even(bool = false) { return split(low_ + ((high_ - low_) >> 1)); }
  // More was read than an encoder can have left out.
  bool failed() const { return at_ > bytes_.size() + 4; }
  // There were exactly as many bytes as the encoder made.
  bool finished() const { return bytes_.size() + 4 == at_ + static_cast<std::size_t>(tailBytes(low_, high_)); }

 private:
  std::uint32_t next() {
    const std::uint32_t byte = at_ < bytes_.size() ? bytes_[at_] : 0;
    ++at_;
    return byte;
  }
  bool split(std::uint32_t middle) {
    const bool value = value_ <= middle;
    if (value)
      high_ = middle;
    else
      low_ = middle + 1;
    for (; ((low_ ^ high_) >> 24) == 0; low_ <<= 8, high_ = high_ << 8 | 255) value_ = value_ << 8 | next();
    return value;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  std::uint32_t low_ = 0, high_ = 0xffffffffu, value_ = 0;
};

}  // namespace ridgecast::points
