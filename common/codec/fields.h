#pragma once
// The fields of a struct to bytes and back. A walk that is written once, for both, serves as writer and as reader:
//
//   bool walk(auto& io, auto& v) { return io(v.number) && io(v.name) && io.list(v.points, [&](auto& p) { return io(p.x) && io(p.z); }); }
//
// Integers are varints (varint.h), signed ones zigzag; a flag is a byte; a double is its 64 bits, the lowest byte first; a string and
// a list are their size, then their bytes or entries. Each call returns whether the bytes were well-formed, so a writer's always do.

#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "common/codec/varint.h"

namespace ridgecast::codec {

// Appends to `bytes`, which must outlive it.
class FieldWriter {
 public:
  static constexpr bool kWrites = true;
  explicit FieldWriter(std::vector<std::uint8_t>& bytes) : bytes_(bytes) {}
  bool operator()(const std::uint64_t& v) { return putVarint(bytes_, v), true; }
  bool operator()(const std::uint32_t& v) { return putVarint(bytes_, v), true; }
  bool operator()(const bool& v) { return bytes_.push_back(v), true; }
  bool operator()(const std::int64_t& v) { return (*this)(zigzag(v)); }
  bool operator()(const double& v) { return fixed(std::bit_cast<std::uint64_t>(v)); }
  bool operator()(const std::string& v) {
    (*this)(std::uint64_t{v.size()});
    bytes_.insert(bytes_.end(), v.begin(), v.end());
    return true;
  }
  // An enum, at most `most`.
  template <class T>
  requires std::is_enum_v<T>
  bool upTo(const T& v, std::uint64_t) { return (*this)(static_cast<std::uint64_t>(v)); }
  bool upTo(const std::uint64_t& v, std::uint64_t) { return (*this)(v); }
  // The lowest `count` bytes.
  bool fixed(const std::uint64_t& v, int count = 8) {
    for (int k = 0; k < 8 * count; k += 8) bytes_.push_back(static_cast<std::uint8_t>(v >> k));
    return true;
  }
  bool list(const auto& values, auto&& each) {
    (*this)(std::uint64_t{values.size()});
    for (const auto& v : values) each(v);
    return true;
  }

 protected:
  std::vector<std::uint8_t>& bytes_;
};

// After a failure the values are of no use. Memory is in proportion to the bytes.
class FieldReader {
 public:
  static constexpr bool kWrites = false;
  explicit FieldReader(std::span<const std::uint8_t> bytes) : reader_(bytes) {}
  bool operator()(std::uint64_t& v) { return reader_.longVarint(v); }
  bool operator()(std::uint32_t& v) {
    std::uint64_t wide = 0;
    if (!(*this)(wide) || wide > 0xffffffffu) return false;
    v = static_cast<std::uint32_t>(wide);
    return true;
  }
  bool operator()(bool& v) {
    std::uint8_t byte = 0;
    if (!reader_.byte(byte) || byte > 1) return false;
    v = byte == 1;
    return true;
  }
  bool operator()(std::int64_t& v) {
    std::uint64_t u = 0;
    if (!(*this)(u)) return false;
    v = unzigzag(u);
    return true;
  }
  // A finite one.
  bool operator()(double& v) {
    std::uint64_t bits = 0;
    if (!fixed(bits)) return false;
    v = std::bit_cast<double>(bits);
    return std::isfinite(v);
  }
  bool operator()(std::string& v) {
    std::uint64_t size = 0;
    std::span<const std::uint8_t> bytes;
    if (!(*this)(size) || !reader_.bytes(size, bytes)) return false;
    v.assign(bytes.begin(), bytes.end());
    return true;
  }
  template <class T>
  requires std::is_enum_v<T>
  bool upTo(T& v, std::uint64_t most) {
    std::uint64_t number = 0;
    if (!upTo(number, most)) return false;
    v = static_cast<T>(number);
    return true;
  }
  bool upTo(std::uint64_t& v, std::uint64_t most) { return (*this)(v) && v <= most; }
  bool fixed(std::uint64_t& v, int count = 8) {
    std::span<const std::uint8_t> bytes;
    if (!reader_.bytes(static_cast<std::uint64_t>(count), bytes)) return false;
    v = 0;
    for (int k = 0; k < count; ++k) v |= std::uint64_t{bytes[static_cast<std::size_t>(k)]} << (8 * k);
    return true;
  }
  // `each` reads at least a byte of each entry.
  bool list(auto& values, auto&& each) {
    std::uint64_t count = 0;
    if (!(*this)(count) || count > reader_.rest().size()) return false;
    for (; count > 0; --count)
      if (!each(values.emplace_back())) return false;
    return true;
  }
  bool isOver() const { return reader_.rest().empty(); }

 protected:
  Reader reader_;
};

}  // namespace ridgecast::codec
