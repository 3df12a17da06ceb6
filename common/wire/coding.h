#pragma once
// Internal to the room: protobuf's encoding of numbers and fields (https://protobuf.dev/programming-guides/encoding), read and written in
// place. Groups, which proto3 does not have, are malformed. protozero would do the same, but reports malformed input by exceptions, which
// the WebAssembly build lacks. Pure functions; any thread.

#include <algorithm>
#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace ridgecast::wire {

using Content = std::span<const std::uint8_t>;

enum class WireType : std::uint8_t { kVarint = 0, kFixed64 = 1, kDelimited = 2, kFixed32 = 5 };

struct Field {
  std::uint32_t number = 0;
  WireType type = WireType::kVarint;
  Content content;  // of a number: as it is encoded
};

// These advance `bytes` past what they read. False: malformed or cut off; `bytes` is unspecified then.
bool takeField(Content& bytes, Field& field);
// Bits beyond 64 are dropped, as everywhere in protobuf.
inline bool takeVarint(Content& bytes, std::uint64_t& value, std::size_t longest = 10) {
  value = 0;
  const std::size_t most = std::min(longest, bytes.size());
  for (std::size_t k = 0; k < most; ++k) {
    value |= std::uint64_t{bytes[k] & 0x7fu} << (7 * k);
    if (bytes[k] < 0x80) {
      bytes = bytes.subspan(k + 1);
      return true;
    }
  }
  return false;
}

constexpr std::size_t varintBytes(std::uint64_t value) { return (static_cast<std::size_t>(std::bit_width(value | 1)) + 6) / 7; }

// All is written twice: first to Counted, which may overestimate, then to a string that is reserved once.
struct Counted {
  std::size_t bytes = 0;
  void append(const char*, std::size_t n) { bytes += n; }
  std::size_t size() const { return bytes; }
};
inline char* layVarint(char* at, std::uint64_t value) {  // at most 10 bytes; returns their end
  for (; value >= 0x80; value >>= 7) *at++ = static_cast<char>(value | 0x80);
  *at++ = static_cast<char>(value);
  return at;
}
inline void putVarint(std::string& out, std::uint64_t value) {
  char bytes[10];
  out.append(bytes, static_cast<std::size_t>(layVarint(bytes, value) - bytes));
}
inline void putVarint(Counted& out, std::uint64_t value) { out.bytes += varintBytes(value); }
void putTag(auto& out, std::uint32_t number, WireType type) { putVarint(out, number << 3 | static_cast<std::uint32_t>(type)); }
// Inserts the length of what follows `begin` before it.
void putLength(std::string& out, std::size_t begin);
inline void putLength(Counted& out, std::size_t begin) { putVarint(out, out.size() - begin); }

// ---- numbers ----

template <class M>
concept Number = std::is_arithmetic_v<M> || std::is_enum_v<M>;

// How a field of the schema holds its number. kOfType: by the value's type; signed is sint32 or sint64.
enum class Form : std::uint8_t { kOfType, kUnsigned, kFixed64 };

template <Number M>
constexpr WireType wireTypeOf(Form form) {
  if (std::is_same_v<M, float>) return WireType::kFixed32;
  return std::is_same_v<M, double> || form == Form::kFixed64 ? WireType::kFixed64 : WireType::kVarint;
}

template <std::unsigned_integral Bits, class M>
bool takeFixed(Content& bytes, M& value) {
  static_assert(std::endian::native == std::endian::little && sizeof(M) == sizeof(Bits));
  if (bytes.size() < sizeof(M)) return false;
  std::memcpy(&value, bytes.data(), sizeof(M));
  bytes = bytes.subspan(sizeof(M));
  return true;
}

template <Number M>
bool takeNumber(Content& bytes, Form form, M& value) {
  if constexpr (std::is_same_v<M, float>) {
    return takeFixed<std::uint32_t>(bytes, value);
  } else if constexpr (std::is_same_v<M, double>) {
    return takeFixed<std::uint64_t>(bytes, value);
  } else {
    std::uint64_t bits = 0;
    if (!(form == Form::kFixed64 ? takeFixed<std::uint64_t>(bytes, bits) : takeVarint(bytes, bits))) return false;
    if constexpr (std::is_same_v<M, bool>) {
      value = bits != 0;
    } else if constexpr (std::is_enum_v<M>) {
      value = static_cast<M>(static_cast<std::int32_t>(bits));
    } else {
      auto own = static_cast<std::make_unsigned_t<M>>(bits);
      if (std::is_signed_v<M> && form == Form::kOfType) own = static_cast<decltype(own)>((own >> 1) ^ (~(own & 1) + 1));
      value = static_cast<M>(own);
    }
    return true;
  }
}

// The bits that a number is encoded as; 0: the field need not be written.
template <Number M>
constexpr std::uint64_t bitsOf(M value, Form form) {
  if constexpr (std::is_same_v<M, float>) {
    return std::bit_cast<std::uint32_t>(value);
  } else if constexpr (std::is_same_v<M, double>) {
    return std::bit_cast<std::uint64_t>(value);
  } else if constexpr (std::is_enum_v<M>) {
    return static_cast<std::uint64_t>(std::int64_t{static_cast<std::int32_t>(value)});
  } else if constexpr (std::is_signed_v<M>) {
    using Own = std::make_unsigned_t<M>;
    const auto own = static_cast<Own>(value);
    return form == Form::kOfType ? static_cast<Own>((own << 1) ^ static_cast<Own>(value < 0 ? -1 : 0)) : own;
  } else {
    return value;
  }
}

template <Number M>
void putNumber(auto& out, Form form, M value) {
  const std::uint64_t bits = bitsOf(value, form);
  const WireType type = wireTypeOf<M>(form);
  if (type == WireType::kVarint) return putVarint(out, bits);
  out.append(reinterpret_cast<const char*>(&bits), type == WireType::kFixed32 ? 4 : 8);
}

// All of a list, packed.
template <Number M>
void putNumbers(Counted& out, Form form, const std::vector<M>& values) {
  if (wireTypeOf<M>(form) != WireType::kVarint) return out.append(nullptr, values.size() * sizeof(M));
  for (const M v : values) out.bytes += varintBytes(bitsOf(v, form));
}
template <Number M>
void putNumbers(std::string& out, Form form, const std::vector<M>& values) {
  if constexpr (std::is_floating_point_v<M>) {
    out.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(M));
  } else {
    Counted counted;
    putNumbers(counted, form, values);
    out.resize(out.size() + counted.bytes);
    char* at = out.data() + out.size() - counted.bytes;
    for (const M v : values) at = layVarint(at, bitsOf(v, form));
  }
}
template <Number M>
bool takeNumbers(Content bytes, Form form, std::vector<M>& values) {
  if constexpr (std::is_floating_point_v<M>) {
    const std::size_t before = values.size();
    values.resize(before + bytes.size() / sizeof(M));
    std::memcpy(values.data() + before, bytes.data(), bytes.size() / sizeof(M) * sizeof(M));
    return bytes.size() % sizeof(M) == 0;
  } else {
    while (!bytes.empty())
      if (M next; takeNumber(bytes, form, next))
        values.push_back(next);
      else
        return false;
    return true;
  }
}

// How many numbers a packed field holds. False: its last one is cut off.
bool countPacked(Content content, WireType type, std::size_t& count);

}  // namespace ridgecast::wire
