#include "common/wire/coding.h"

#include <algorithm>

namespace ridgecast::wire {

bool takeField(Content& bytes, Field& field) {
  std::uint64_t read = 0;
  if (!takeVarint(bytes, read, 5)) return false;
  const auto tag = static_cast<std::uint32_t>(read);
  field = {.number = tag >> 3, .type = static_cast<WireType>(tag & 7), .content = {}};
  if (field.number == 0) return false;
  std::uint64_t length = 0;
  Content rest = bytes;
  switch (field.type) {
    case WireType::kVarint:
      if (!takeVarint(rest, read)) return false;
      length = bytes.size() - rest.size();
      break;
    case WireType::kFixed64:
      length = 8;
      break;
    case WireType::kFixed32:
      length = 4;
      break;
    case WireType::kDelimited:
      if (!takeVarint(bytes, length, 5)) return false;
      break;
    default:
      return false;
  }
  if (length > bytes.size()) return false;
  field.content = bytes.first(length);
  bytes = bytes.subspan(length);
  return true;
}

void putLength(std::string& out, std::size_t begin) {
  std::string length;
  putVarint(length, out.size() - begin);
  out.insert(begin, length);
}

bool countPacked(Content content, WireType type, std::size_t& count) {
  if (type == WireType::kVarint) {
    count = static_cast<std::size_t>(std::count_if(content.begin(), content.end(), [](std::uint8_t byte) { return byte < 0x80; }));
    return content.empty() || content.back() < 0x80;
  }
  const std::size_t each = type == WireType::kFixed32 ? 4 : 8;
  count = content.size() / each;
  return content.size() % each == 0;
}

}  // namespace ridgecast::wire
