#include "server/net/listener.h"

#include <boost/asio/post.hpp>
#include <boost/asio/strand.hpp>
#include <utility>

#include "common/outcome/contract.h"
#include "server/logging/logging.h"
#include "server/net/server_context.h"

namespace ridgecast::net {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

Listener::Listener(asio::io_context& io) : io_(io), acceptor_(asio::make_strand(io)), retry_(acceptor_.get_executor()) {}

Outcome<tcp::endpoint> Listener::resolve(const std::string& host, std::uint16_t port) {
  error_code ec;
  tcp::resolver resolver(io_);
  const auto found = resolver.resolve(host, std::to_string(port), tcp::resolver::passive | tcp::resolver::numeric_service, ec);
  if (ec || found.empty())
    return Error{"Cannot listen on '" + host + "': it is not an address or name of this machine; 127.0.0.1 is the usual one."};
  return found.begin()->endpoint();
}

std::optional<Error> Listener::open(const tcp::endpoint& endpoint) {
  error_code ec;
  const std::string where = nameOf(endpoint);
  acceptor_.open(endpoint.protocol(), ec);
  if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "."};
  acceptor_.set_option(asio::socket_base::reuse_address(true), ec);
  acceptor_.bind(endpoint, ec);
  if (!ec) acceptor_.listen(asio::socket_base::max_listen_connections, ec);
  if (ec == asio::error::address_in_use)
    return Error{"Cannot listen on " + where + ": the port is in use; choose another with --port, or --port 0 for any free one."};
  if (ec == asio::error::access_denied)
    return Error{"Cannot listen on " + where + ": this user lacks the permission; choose a port above 1023."};
  if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "; 127.0.0.1 is the usual address."};
  endpoint_ = acceptor_.local_endpoint(ec);
  return {};
}

void Listener::start(Take take) {
  expects(take && acceptor_.is_open() && !take_, "a port is open before it accepts connections, for one server");
  take_ = std::move(take);
  asio::post(acceptor_.get_executor(), [this] { accept(); });
}

void Listener::accept() {
  acceptor_.async_accept(asio::make_strand(io_), [this](error_code ec, tcp::socket socket) {
    if (ec == asio::error::operation_aborted) return;
    if (!ec) {
      take_(std::move(socket));
      return accept();
    }
    // Probably no file descriptors are left; open connections may end.
    logging::warning("cannot accept a connection: " + ec.message());
    retry_.expires_after(std::chrono::milliseconds(200));
    retry_.async_wait([this](error_code waited) {
      if (!waited) accept();
    });
  });
}

}  // namespace ridgecast::net
