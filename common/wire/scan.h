#pragma once
// Looks at a protobuf message without building it.

#include <cstdint>
#include <span>

namespace ridgecast::wire {

// One field: its number, and its content when it is length-delimited.
struct Field {
  std::uint32_t number = 0;
  bool delimited = false;
  std::span<const std::uint8_t> content;
};
// Moves `bytes` behind the field. False: malformed (groups count as malformed).
bool nextField(std::span<const std::uint8_t>& bytes, Field& field);

}  // namespace ridgecast::wire
