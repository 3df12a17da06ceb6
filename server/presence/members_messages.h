#pragma once
// What servers tell each other of their members, as messages of a bus: a byte, kFormat, then a wire::Members with each member whole
// (`joined`) and those that have left.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::presence {

// Puts as much into a message as fits.
class MembersMessages {
 public:
  static constexpr char kFormat = 1;
  static constexpr std::size_t kMaxBytes = 256u << 10;

  void add(const wire::Member& member);
  void left(std::uint64_t camera);
  std::vector<std::string> take();  // all; once

 private:
  void put(const wire::Members& part);

  std::vector<std::string> done_;
  std::string parts_;
};

// Error: not a message of this format; one sentence.
Outcome<wire::Members> membersOf(const std::string& message);

}  // namespace ridgecast::presence
