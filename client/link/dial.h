#pragma once
// Opens a connection to a server, for any protocol. Internal to the room.

#include <boost/asio/connect.hpp>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "client/core/conversation/url.h"
#include "common/transport/channel.h"

namespace ridgecast::link {

enum class Dialing { kResolving, kConnecting, kConnected };

// Looks up, connects and, if the URL says so, speaks TLS. `done` gets nothing, or why it failed; `step` says how far it is. The other
// arguments must outlive it.
inline void dial(const core::Url& url, boost::asio::ip::tcp::resolver& resolver, transport::Channel& channel, Dialing& step,
                 const std::function<void(std::optional<std::string>)>& done) {
  resolver.async_resolve(url.host, url.port, [&, done](boost::system::error_code e, const auto& found) {
    if (e) return done("the host '" + url.host + "' is not known (" + e.message() + "); check the server's address");
    step = Dialing::kConnecting;
    boost::asio::async_connect(channel.socket(), found, [&, done](boost::system::error_code failed, const auto&) {
      if (failed == boost::asio::error::connection_refused)
        return done("no server at " + url.where() + "; start one with ridgecast-server --port " + url.port);
      if (failed) return done("no connection to " + url.where() + ": " + failed.message());
      step = Dialing::kConnected;
      if (!url.secure) return done(std::nullopt);
      channel.startTls(url.host, {url.ca}, [&url, done](std::optional<std::string> wrong) {
        if (wrong) wrong = "no secure connection to " + url.where() + ": " + *wrong;
        done(std::move(wrong));
      });
    });
  });
}

}  // namespace ridgecast::link
