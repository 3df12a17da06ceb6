#pragma once
// A message as a client reads it.

#include <string>

#include "common/wire/wire.h"
#include "tests/support/bytes.h"

namespace ridgecast::testing_support {

inline wire::ServerMessage decoded(const std::string& message) { return wire::decodeServer(bytesOf(message)).value(); }

}  // namespace ridgecast::testing_support
