#pragma once
// A message as a client reads it.

#include <string>

#include "common/wire/wire.h"

namespace ridgecast::testing_support {

inline wire::ServerMessage decoded(const std::string& message) {
  return wire::decodeServer({reinterpret_cast<const std::uint8_t*>(message.data()), message.size()}).value();
}

}  // namespace ridgecast::testing_support
