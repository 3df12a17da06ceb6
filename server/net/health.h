#pragma once
// Asks a running server whether it is well, as containers' checks do.

#include <optional>

#include "common/outcome/outcome.h"
#include "server/net/server.h"

namespace ridgecast::net {

// GET /healthz in plain HTTP at the admin port, or at the port if it has no TLS, on this machine. Takes at most 2 seconds.
// Error, for people: no answer, another one, or a server that has TLS and no admin port.
std::optional<Error> checkHealth(const Settings& settings);

}  // namespace ridgecast::net
