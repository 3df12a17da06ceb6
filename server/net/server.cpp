#include "server/net/server.h"

#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "server/net/http.h"
#include "server/net/shared.h"

namespace ridgecast::net {

std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port());
}

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

// Connections beyond the limit that are still told so, instead of being closed at once.
constexpr std::uint32_t kRefusedAtATime = 32;
constexpr std::chrono::milliseconds kShutdownPatience{500};

class ListeningServer final : public Server {
 public:
  ListeningServer(const Settings& settings, std::shared_ptr<session::Directory> directory, std::vector<Route> routes)
      : shared_(std::make_shared<Shared>(settings, std::move(directory), std::move(routes))),
        acceptor_(asio::make_strand(io_)),
        retry_(acceptor_.get_executor()) {}

  ~ListeningServer() override { shutdown(); }

  std::optional<Error> open() {
    const Settings& settings = shared_->settings;
    error_code ec;
    tcp::resolver resolver(io_);
    const auto found =
        resolver.resolve(settings.host, std::to_string(settings.port), tcp::resolver::passive | tcp::resolver::numeric_service, ec);
    if (ec || found.empty())
      return Error{"Cannot listen on '" + settings.host + "': it is no address or name of this machine; 127.0.0.1 is the usual one."};
    const tcp::endpoint endpoint = found.begin()->endpoint();
    if (!endpoint.address().is_loopback() && !settings.allowInsecure)
      return Error{"Refusing to listen on " + settings.host +
                   ": there is no encryption and no access control yet, so everybody who reaches the port could use it; say "
                   "--allow-insecure if that "
                   "is meant, or listen on 127.0.0.1."};
    const std::string where = nameOf(endpoint);
    acceptor_.open(endpoint.protocol(), ec);
    if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "."};
    acceptor_.set_option(asio::socket_base::reuse_address(true), ec);
    acceptor_.bind(endpoint, ec);
    if (!ec) acceptor_.listen(asio::socket_base::max_listen_connections, ec);
    if (ec == asio::error::address_in_use)
      return Error{"Cannot listen on " + where + ": the port is in use; choose another with --port, or --port 0 for any free one."};
    if (ec == asio::error::access_denied)
      return Error{"Cannot listen on " + where + ": that takes rights this user lacks; choose a port above 1023."};
    if (ec) return Error{"Cannot listen on " + where + ": " + ec.message() + "; 127.0.0.1 is the usual address."};
    endpoint_ = acceptor_.local_endpoint(ec);
    asio::post(acceptor_.get_executor(), [this] { accept(); });
    for (unsigned k = 0; k < std::max(1u, settings.threads); ++k) threads_.emplace_back([this] { serve(); });
    return {};
  }

  std::uint16_t port() const override { return endpoint_.port(); }
  std::string url() const override { return "http://" + nameOf(endpoint_); }

  void shutdown() override {
    if (threads_.empty()) return;
    shared_->promptJobs.stop();
    shared_->patientJobs.stop();
    asio::post(acceptor_.get_executor(), [this] {
      error_code ignored;
      acceptor_.close(ignored);
      retry_.cancel();
    });
    std::vector<std::shared_ptr<OpenStream>> streams;
    {
      const std::lock_guard lock(shared_->mutex);
      for (const auto& [key, weak] : shared_->streams)
        if (auto stream = weak.lock()) streams.push_back(std::move(stream));
    }
    for (auto& stream : streams) stream->postGoingAway();
    streams.clear();
    {
      std::unique_lock lock(shared_->mutex);
      shared_->fewerStreams.wait_for(lock, kShutdownPatience, [this] { return shared_->streams.empty(); });
    }
    io_.stop();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  void serve() {
    for (;;) {
      try {
        io_.run();
        return;
      } catch (const std::exception& e) {
        spdlog::error("a connection failed: {}", e.what());
      }
    }
  }

  void accept() {
    acceptor_.async_accept(asio::make_strand(io_), [this](error_code ec, tcp::socket socket) {
      if (ec == asio::error::operation_aborted || !acceptor_.is_open()) return;
      if (ec) {  // most likely out of file descriptors: the ones that are open may end
        spdlog::warn("cannot accept a connection: {}", ec.message());
        retry_.expires_after(std::chrono::milliseconds(200));
        retry_.async_wait([this](error_code waited) {
          if (!waited) accept();
        });
        return;
      }
      Counted counted(shared_);
      if (counted.rank() <= shared_->settings.maxConnections + kRefusedAtATime) startHttp(std::move(socket), std::move(counted), shared_);
      accept();
    });
  }

  std::shared_ptr<Shared> shared_;
  asio::io_context io_;
  tcp::acceptor acceptor_;
  asio::steady_timer retry_;
  tcp::endpoint endpoint_;
  std::vector<std::thread> threads_;
};

}  // namespace

Outcome<std::unique_ptr<Server>> Server::listen(const Settings& settings, std::shared_ptr<session::Directory> directory,
                                                std::vector<Route> routes) {
  auto server = std::make_unique<ListeningServer>(settings, std::move(directory), std::move(routes));
  if (auto error = server->open()) return std::move(*error);
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ridgecast::net
