#pragma once
// Little-endian base 128 integers (LEB128), and zigzag for signed ones.

#include <cstdint>
#include <span>
#include <vector>

namespace ridgecast::codec {

inline void putVarint(std::vector<std::uint8_t>& out, std::uint64_t v) {
  for (; v >= 0x80; v >>= 7) out.push_back(static_cast<std::uint8_t>(v | 0x80));
  out.push_back(static_cast<std::uint8_t>(v));
}
constexpr std::uint64_t zigzag(std::int64_t v) { return (static_cast<std::uint64_t>(v) << 1) ^ static_cast<std::uint64_t>(v >> 63); }
constexpr std::int64_t unzigzag(std::uint64_t v) { return static_cast<std::int64_t>(v >> 1) ^ -static_cast<std::int64_t>(v & 1); }

// Reads from the front of a span. After a failure every read fails.
class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  bool byte(std::uint8_t& v) {
    if (at_ >= bytes_.size()) return false;
    v = bytes_[at_++];
    return true;
  }
  // At most five bytes, 35 bits.
  bool varint(std::uint64_t& v) { return varint(v, 35); }
  // At most ten bytes; bits beyond 64 are dropped.
  bool longVarint(std::uint64_t& v) { return varint(v, 70); }
  bool zigzagged(std::int64_t& v) {
    std::uint64_t u = 0;
    if (!varint(u)) return false;
    v = unzigzag(u);
    return true;
  }
  bool bytes(std::uint64_t count, std::span<const std::uint8_t>& out) {
    if (count > bytes_.size() - at_) {
      at_ = bytes_.size();
      return false;
    }
    out = bytes_.subspan(at_, count);
    at_ += count;
    return true;
  }
  std::span<const std::uint8_t> rest() const { return bytes_.subspan(at_); }

 private:
  bool varint(std::uint64_t& v, int bits) {
    v = 0;
    for (int shift = 0; shift < bits; shift += 7) {
      std::uint8_t b = 0;
      if (!byte(b)) return false;
      v |= std::uint64_t{b & 0x7fu} << shift;
      if (b < 0x80) return true;
    }
    at_ = bytes_.size();
    return false;
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

}  // namespace ridgecast::codec
