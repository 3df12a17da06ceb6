#include "tests/bench/frames.h"

#include <cstdint>

namespace ridgecast::bench {

std::string maskedFrame(int opcode, std::string_view payload) {
  std::string out(1, static_cast<char>(0x80 | opcode));
  if (payload.size() < 126) {
    out += static_cast<char>(0x80 | payload.size());
  } else {
    out += static_cast<char>(0x80 | 126);
    out += static_cast<char>(payload.size() >> 8);
    out += static_cast<char>(payload.size());
  }
  out.append(4, '\0');  // the mask
  return out.append(payload);
}

std::optional<Frame> firstFrame(std::string_view in) {
  const auto byte = [&](std::size_t k) { return static_cast<std::uint64_t>(static_cast<unsigned char>(in[k])); };
  if (in.size() < 2) return {};
  std::uint64_t length = byte(1) & 127;
  const std::size_t header = length == 126 ? 4 : length == 127 ? 10 : 2;
  if (in.size() < header) return {};
  if (header > 2) length = 0;
  for (std::size_t k = 2; k < header; ++k) length = length << 8 | byte(k);
  if (in.size() - header < length) return {};
  return Frame{static_cast<int>(byte(0) & 15), in.substr(header, length), header + length};
}

}  // namespace ridgecast::bench
