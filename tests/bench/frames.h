#pragma once
// WebSocket frames as a client writes and reads them.

#include <optional>
#include <string>
#include <string_view>

namespace ridgecast::bench {

// One whole message below 64 KiB, masked with zeros.
std::string maskedFrame(int opcode, std::string_view payload);

struct Frame {
  int opcode = 0;
  std::string_view payload;  // in what was read
  std::size_t bytes = 0;     // with the header
};
// The first frame of what a server sent, unmasked. Nothing: it has not come whole.
std::optional<Frame> firstFrame(std::string_view in);

}  // namespace ridgecast::bench
