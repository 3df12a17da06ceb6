#pragma once
// A WebSocket stream: passes a client's messages to its camera session and the session's to the client. Private to the room.

#include <memory>
#include <string>

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

#include "server/access/rights.h"
#include "server/net/server_context.h"

namespace ridgecast::net {

// What the filter judges of a request; views into the header.
Request requestOf(const boost::beast::http::request_header<>& header);

// Answers the upgrade in `request` and serves the stream until either side ends it. `peer`: the client's address, for the log. Call on the
// connection's strand.
void startStream(Channel&& channel, ConnectionSlot slot, std::shared_ptr<ServerContext> shared, std::shared_ptr<session::Session> session,
                 std::string peer, access::Grant grant, boost::beast::http::request<boost::beast::http::empty_body> request);

}  // namespace ridgecast::net
