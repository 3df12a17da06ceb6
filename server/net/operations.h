#pragma once
// Operations: GET /readyz and GET /metrics. Private to the room.

#include "server/net/server_context.h"

namespace ridgecast::net {

// Adds the routes, and the metrics that are computed when scraped. Call before connections are accepted.
void addOperations(const std::shared_ptr<ServerContext>& shared);

}  // namespace ridgecast::net
