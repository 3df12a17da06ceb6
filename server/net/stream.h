#pragma once
// A WebSocket stream: a client's messages go to its camera session, the session's messages to the client. For the room's own sources.

#include <memory>
#include <string>

#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>

#include "server/access/grant.h"
#include "server/net/shared.h"

namespace ridgecast::net {

// `peer`: the client's address, for the log. Answers the upgrade that `request` asks for and serves the stream until either side ends it. On the connection's strand.
void startStream(Channel&& channel, Counted counted, std::shared_ptr<Shared> shared, std::shared_ptr<session::Session> session,
                 std::string peer, access::Grant grant, boost::beast::http::request<boost::beast::http::empty_body> request);

}  // namespace ridgecast::net
