#include "server/net/server.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/strand.hpp>
#include <thread>
#include <utility>

#include "server/logging/logging.h"
#include "server/net/http.h"
#include "server/net/operations.h"
#include "server/net/shared.h"

namespace ridgecast::net {

std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port());
}

access::Address addressOf(const boost::asio::ip::tcp::endpoint& endpoint) {
  const auto address = endpoint.address();
  return (address.is_v6() ? address.to_v6() : boost::asio::ip::make_address_v6(boost::asio::ip::v4_mapped, address.to_v4())).to_bytes();
}

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

// Connections beyond a limit that still get an answer; any more are closed at once.
constexpr std::uint32_t kTurnedAtATime = 32;

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
      return Error{"Cannot listen on '" + settings.host + "': it is not an address or name of this machine; 127.0.0.1 is the usual one."};
    const tcp::endpoint endpoint = found.begin()->endpoint();
    if (settings.tlsCertificate.empty() != settings.tlsKey.empty())
      return Error{"TLS takes both a certificate and its key: --tls-cert FILE --tls-key FILE."};
    const bool encrypted = !settings.tlsCertificate.empty();
    if (!endpoint.address().is_loopback() && !settings.allowInsecure && !(encrypted && shared_->filter.requiresTokens()))
      return Error{"Refusing to listen on " + settings.host + " without " +
                   (encrypted                          ? "tokens"
                    : shared_->filter.requiresTokens() ? "TLS"
                                                       : "TLS and tokens") +
                   ": everybody who reaches the port could use it or listen in; give --tls-cert and --tls-key, and --token-file or "
                   "--jwt-secret-file, or listen on 127.0.0.1, or say --allow-insecure if it is meant."};
    if (auto error = reload()) return error;
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
    addOperations(shared_);
    asio::post(acceptor_.get_executor(), [this] { accept(); });
    for (unsigned k = 0; k < std::max(1u, settings.threads); ++k) threads_.emplace_back([this] { serve(); });
    return {};
  }

  std::uint16_t port() const override { return endpoint_.port(); }
  std::string url() const override { return (shared_->settings.tlsCertificate.empty() ? "http://" : "https://") + nameOf(endpoint_); }

  std::optional<Error> reload() override {
    const Settings& settings = shared_->settings;
    std::shared_ptr<TlsContext> tls;
    if (!settings.tlsCertificate.empty()) {
      auto loaded = loadTls(settings.tlsCertificate, settings.tlsKey);
      if (!loaded) return loaded.error();
      tls = std::move(*loaded);
    }
    if (auto error = shared_->filter.load()) return error;
    {
      const std::lock_guard lock(shared_->mutex);
      shared_->tls = std::move(tls);
    }
    for (const auto& stream : openStreams()) stream->postJudge();
    return {};
  }

  void drain() override {
    shared_->ready = false;
    sendAway();
  }
  void undrain() override { shared_->ready = true; }

  void shutdown() override {
    if (threads_.empty()) return;
    shared_->ready = false;
    const auto until = std::chrono::steady_clock::now() + shared_->settings.drain;
    asio::post(acceptor_.get_executor(), [this] {
      error_code ignored;
      acceptor_.close(ignored);
      retry_.cancel();
    });
    sendAway();
    shared_->promptJobs.finish(until);
    shared_->patientJobs.finish(until);
    shared_->worldJobs.finish(until);
    {
      std::unique_lock lock(shared_->mutex);
      shared_->fewer.wait_until(lock, until, [this] { return shared_->streams.empty() && shared_->answerBytes == 0; });
    }
    io_.stop();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  std::vector<std::shared_ptr<OpenStream>> openStreams() {
    std::vector<std::shared_ptr<OpenStream>> streams;
    const std::lock_guard lock(shared_->mutex);
    for (const auto& [key, weak] : shared_->streams)
      if (auto stream = weak.lock()) streams.push_back(std::move(stream));
    return streams;
  }
  void sendAway() {
    for (const auto& stream : openStreams()) stream->postGoingAway();
  }

  void serve() {
    for (;;) {
      try {
        io_.run();
        return;
      } catch (const std::exception& e) {
        logging::error(std::string("a connection failed: ") + e.what());
      }
    }
  }

  void accept() {
    acceptor_.async_accept(asio::make_strand(io_), [this](error_code ec, tcp::socket socket) {
      if (ec == asio::error::operation_aborted || !acceptor_.is_open()) return;
      if (ec) {  // probably no file descriptors left: open connections may end
        logging::warning("cannot accept a connection: " + ec.message());
        retry_.expires_after(std::chrono::milliseconds(200));
        retry_.async_wait([this](error_code waited) {
          if (!waited) accept();
        });
        return;
      }
      take(std::move(socket));
      accept();
    });
  }

  // Checks everything that limits connections before anything is made for this one.
  void take(tcp::socket&& socket) {
    const Settings& settings = shared_->settings;
    shared_->figures->connections.Increment();
    error_code gone;
    const tcp::endpoint peer = socket.remote_endpoint(gone);
    if (gone) return;
    const access::Address address = addressOf(peer);
    const auto isProxy = [&](const access::Network& network) { return network.contains(address); };
    auto surplus = Counted::Surplus::kNone;
    std::optional<access::ConnectionsByAddress::Place> place;
    if (shared_->connections >= settings.maxConnections) {
      surplus = Counted::Surplus::kConnections;
    } else if (std::none_of(settings.trustedProxies.begin(), settings.trustedProxies.end(), isProxy)) {
      place = shared_->connectionsByAddress.enter(address);
      if (!place) surplus = Counted::Surplus::kAddress;
    }
    if (surplus != Counted::Surplus::kNone) {
      shared_->figures->refused(surplus == Counted::Surplus::kAddress ? metrics::Refusal::kAddress : metrics::Refusal::kConnections);
      if (shared_->turned >= kTurnedAtATime) return;
    }
    startHttp(std::move(socket), Counted(shared_, surplus, std::move(place)), shared_);
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
