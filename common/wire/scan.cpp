#include "common/wire/scan.h"

namespace ridgecast::wire {
namespace {

bool readVarint(std::span<const std::uint8_t>& bytes, std::uint64_t& value) {
  value = 0;
  for (unsigned k = 0; k < 10 && k < bytes.size(); ++k) {
    value |= std::uint64_t{bytes[k] & 0x7fu} << (7 * k);
    if (bytes[k] < 0x80) {
      bytes = bytes.subspan(k + 1);
      return true;
    }
  }
  return false;
}

bool skip(std::span<const std::uint8_t>& bytes, std::uint64_t count) {
  if (count > bytes.size()) return false;
  bytes = bytes.subspan(count);
  return true;
}

}  // namespace

bool nextField(std::span<const std::uint8_t>& bytes, Field& field) {
  std::uint64_t tag = 0, value = 0;
  if (!readVarint(bytes, tag) || tag > 0xffffffffu || tag >> 3 == 0) return false;
  field = {.number = static_cast<std::uint32_t>(tag >> 3), .delimited = false, .content = {}};
  switch (tag & 7) {
    case 0:
      return readVarint(bytes, value);
    case 1:
      return skip(bytes, 8);
    case 2: {
      if (!readVarint(bytes, value)) return false;
      const std::span<const std::uint8_t> all = bytes;
      if (!skip(bytes, value)) return false;
      field.delimited = true;
      field.content = all.first(value);
      return true;
    }
    case 5:
      return skip(bytes, 4);
    default:
      return false;
  }
}

}  // namespace ridgecast::wire
