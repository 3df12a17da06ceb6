#pragma once
// A connection before it is a stream: HTTP requests and answers, one after another. Private to the room.

#include <memory>

#include <boost/asio/ip/tcp.hpp>

#include "server/net/server_context.h"

namespace ridgecast::net {

// Serves the connection until either side ends it or it becomes a stream. `socket` runs on its own strand.
void startHttp(boost::asio::ip::tcp::socket&& socket, ConnectionSlot slot, std::shared_ptr<ServerContext> shared);

}  // namespace ridgecast::net
