#pragma once
// Looks at a protobuf message without building it: how often does each field occur?

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace ridgecast::wire {

inline constexpr std::size_t kScannedFields = 32;

// Occurrences of the fields 1..31; later ones count as 0.
using FieldCounts = std::array<std::size_t, kScannedFields>;

// Adds the occurrences of the fields of the message, and calls `inside(field, bytes)` for each length-delimited one. False when the bytes
// are no well-formed sequence of fields (groups count as malformed) or when `inside` returns false.
template <class Inside>
bool scanFields(std::span<const std::uint8_t> bytes, FieldCounts& counts, const Inside& inside);

// One field: its number, and its content when it is length-delimited. Moves `bytes` behind it. False: malformed.
struct Field {
  std::uint32_t number = 0;
  bool delimited = false;
  std::span<const std::uint8_t> content;
};
bool nextField(std::span<const std::uint8_t>& bytes, Field& field);

template <class Inside>
bool scanFields(std::span<const std::uint8_t> bytes, FieldCounts& counts, const Inside& inside) {
  Field field;
  while (!bytes.empty()) {
    if (!nextField(bytes, field)) return false;
    if (field.number < counts.size()) ++counts[field.number];
    if (field.delimited && !inside(field.number, field.content)) return false;
  }
  return true;
}

}  // namespace ridgecast::wire
