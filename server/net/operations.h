#pragma once
// Operations: GET /readyz and GET /metrics. Private to the room.

#include "server/net/server_context.h"

namespace ridgecast::net {

// How full the server is, 0 to 1: the fullest of cameras, connections, sessions and triangles.
double saturation(ServerContext& context);
// Adds the routes, and the metrics that are computed when scraped. Call before connections are accepted.
void addOperations(const std::shared_ptr<ServerContext>& shared);

}  // namespace ridgecast::net
