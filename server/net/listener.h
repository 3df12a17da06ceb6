#pragma once
// A port that accepts connections. Private to the room.

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>

#include "common/outcome/outcome.h"

namespace ridgecast::net {

// Must outlive the run of its io_context.
class Listener {
 public:
  using Take = std::function<void(boost::asio::ip::tcp::socket&&)>;

  explicit Listener(boost::asio::io_context& io);

  // Error, for people: `host` is not an address or name of this machine.
  Outcome<boost::asio::ip::tcp::endpoint> resolve(const std::string& host, std::uint16_t port);
  // Error, for people: not this machine's address, or the port is in use or not permitted.
  std::optional<Error> open(const boost::asio::ip::tcp::endpoint& endpoint);
  // After open(): hands each connection to `take`, one at a time, until the io_context stops. Its socket runs on a strand of its own.
  void start(Take take);

  const boost::asio::ip::tcp::endpoint& endpoint() const { return endpoint_; }

 private:
  void accept();

  boost::asio::io_context& io_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  boost::asio::ip::tcp::endpoint endpoint_;
  Take take_;
};

}  // namespace ridgecast::net
