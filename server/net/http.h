#pragma once
// A connection before it is a stream: HTTP requests and answers, one after another. Private to the room.

#include <memory>

#include <boost/asio/ip/tcp.hpp>

#include "server/net/shared.h"

namespace ridgecast::net {

// Serves the connection until either side ends it or it becomes a stream. `socket` runs on its own strand.
void startHttp(boost::asio::ip::tcp::socket&& socket, Counted counted, std::shared_ptr<Shared> shared);

}  // namespace ridgecast::net
