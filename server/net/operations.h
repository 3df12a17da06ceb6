#pragma once
// What those who run the server ask for: GET /readyz and GET /metrics. For the room's own sources.

#include "server/net/shared.h"

namespace ridgecast::net {

// Adds the routes, and the figures that are asked for when they are scraped. Before connections are accepted.
void addOperations(const std::shared_ptr<Shared>& shared);

}  // namespace ridgecast::net
