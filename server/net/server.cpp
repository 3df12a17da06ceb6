#include "server/net/server.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <thread>
#include <utility>

#include "server/http/lists.h"
#include "server/http/worlds.h"
#include "server/logging/logging.h"
#include "server/net/fetch.h"
#include "server/net/http.h"
#include "server/net/listener.h"
#include "server/net/operations.h"
#include "server/net/server_context.h"
#include "server/net/withdrawals.h"

namespace ridgecast::net {

constexpr std::chrono::seconds kFetchTimeout{10};

std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint) {
  const std::string address = endpoint.address().to_string();
  return (endpoint.address().is_v6() ? "[" + address + "]" : address) + ":" + std::to_string(endpoint.port());
}

access::Address addressOf(const boost::asio::ip::tcp::endpoint& endpoint) {
  const auto address = endpoint.address();
  return (address.is_v6() ? address.to_v6() : boost::asio::ip::make_address_v6(boost::asio::ip::v4_mapped, address.to_v4())).to_bytes();
}

access::IssuerKeys::Fetch keysOf(const access::Files& files) {
  if (files.keyUrl.empty()) return {};
  return [url = HttpsUrl::parse(files.keyUrl), authorities = files.keyAuthorities](const std::stop_token& stop) -> Outcome<std::string> {
    if (!url) return url.error();
    return fetch(*url, authorities, access::kMaxKeyBytes, kFetchTimeout, stop);
  };
}

namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using namespace std::chrono_literals;

// Connections beyond a limit that still get an answer; any more are closed at once.
constexpr std::uint32_t kTurnedAtATime = 32;
// Between two streams that a server that drains sends away.
constexpr std::chrono::milliseconds kBetweenStreams{150};
// Connections of the admin port; any more are closed at once.
constexpr std::uint32_t kAdminsAtATime = 64;

class ListeningServer final : public Server {
 public:
  ListeningServer(const Settings& settings, std::shared_ptr<directory::Directory> directory, std::vector<Route> routes)
      : shared_(std::make_shared<ServerContext>(settings, std::move(directory), std::move(routes))), listener_(io_), adminListener_(io_) {
    const session::Resources& resources = shared_->directory->resources();
    withdrawals_ = std::make_shared<Withdrawals>(resources.bus, *resources.timer, [weak = std::weak_ptr(shared_)](const auto& hashes) {
      const auto context = weak.lock();
      if (!context) return;
      context->filter.withdraw(hashes);
      for (const auto& stream : context->streams.all()) stream->postJudge();
    });
  }

  ~ListeningServer() override { shutdown(); }

  std::optional<Error> open() {
    const Settings& settings = shared_->settings;
    const auto endpoint = listener_.resolve(settings.host, settings.port);
    if (!endpoint) return endpoint.error();
    if (settings.tlsCertificate.empty() != settings.tlsKey.empty())
      return Error{"TLS takes both a certificate and its key: --tls-cert FILE --tls-key FILE."};
    const bool encrypted = !settings.tlsCertificate.empty();
    if (!endpoint->address().is_loopback() && !settings.allowInsecure && !(encrypted && shared_->filter.requiresTokens()))
      return Error{"Refusing to listen on " + settings.host + " without " +
                   (encrypted                          ? "tokens"
                    : shared_->filter.requiresTokens() ? "TLS"
                                                       : "TLS and tokens") +
                   ": everybody who reaches the port could use it or listen in; give --tls-cert and --tls-key, and --token-file or "
                   "--jwt-secret-file, or listen on 127.0.0.1, or say --allow-insecure if that is intended."};
    if (auto error = reload()) return error;
    if (auto error = listener_.open(*endpoint)) return error;
    if (settings.adminPort != 0) {
      const auto admin = adminListener_.resolve(settings.adminHost.empty() ? settings.host : settings.adminHost, settings.adminPort);
      if (!admin) return admin.error();
      if (auto error = adminListener_.open(*admin)) return error;
      adminListener_.start([this](tcp::socket&& socket) { takeAdmin(std::move(socket)); });
    }
    addOperations(shared_);
    takeUp();
    withdrawals_->begin();
    listener_.start([this](tcp::socket&& socket) { take(std::move(socket)); });
    for (unsigned k = 0; k < std::max(1u, settings.threads); ++k) threads_.emplace_back([this] { serve(); });
    return {};
  }

  std::uint16_t port() const override { return listener_.endpoint().port(); }
  std::string url() const override {
    return (shared_->settings.tlsCertificate.empty() ? "http://" : "https://") + nameOf(listener_.endpoint());
  }
  std::string adminUrl() const override { return shared_->settings.adminPort != 0 ? "http://" + nameOf(adminListener_.endpoint()) : ""; }

  std::optional<Error> reload() override {
    auto error = reloadAll();
    shared_->reloaded = !error;
    return error;
  }

  void drain() override { drain(*shared_); }
  void undrain() override { shared_->ready = shared_->takesStreams = true; }

  void sendAway(const session::Session& session) override {
    for (const auto& stream : shared_->streams.all())
      if (&stream->session() == &session) stream->postGoingAway();
  }

  void shutdown() override {
    if (threads_.empty()) return;
    shared_->ready = false;
    std::this_thread::sleep_for(shared_->settings.drainDelay);
    const auto until = std::chrono::steady_clock::now() + shared_->settings.drain;
    drain();
    for (const auto& session : shared_->directory->all()) session->retire();  // so that the next server has their edits at once
    for (Work& work : shared_->queues) work.jobs.finish(until);
    shared_->streams.awaitNone(until);
    shared_->unsent->awaitNone(until);
    io_.stop();
    for (auto& thread : threads_) thread.join();
    threads_.clear();
  }

 private:
  void takeUp() {
    directory::Directory& directory = *shared_->directory;
    shared_->takesUp = directory.isShared() && !directory.resources().state.empty();
    const auto work = http::takingUp(directory);  // before they are heard
    joinOthers();
    if (!shared_->takesUp) return;
    const std::stop_source job;
    Jobs& jobs = shared_->work(Queue::kWorlds).jobs;
    jobs.post(job,
              [context = shared_.get(), work, wake = [&jobs, job] { jobs.wake(job); }](std::stop_token stop) -> std::optional<RetryAt> {
                const Reply reply = work({std::move(stop), wake});
                if (const auto* retry = std::get_if<RetryAt>(&reply)) return *retry;
                context->takesUp = false;
                return {};
              });
  }

  void joinOthers() {
    const auto streamsOf = [](const ServerContext& context, const session::Session& session, const std::function<void(OpenStream&)>& end) {
      for (const auto& stream : context.streams.all())
        if (&stream->session() == &session) end(*stream);
    };
    // Weak: the directory may outlive this server.
    const std::weak_ptr<ServerContext> weak = shared_;
    shared_->directory->join({.url = shared_->settings.url.empty() ? url() : shared_->settings.url,
                              .load =
                                  [weak] {
                                    const auto context = weak.lock();
                                    return context ? saturation(*context) : 1;
                                  },
                              .entry = sessionEntry,
                              .remove =
                                  [weak, streamsOf](const session::Session& session, std::optional<std::uint64_t> camera) {
                                    if (const auto context = weak.lock())
                                      streamsOf(*context, session, [&](OpenStream& stream) { stream.postRemove(camera); });
                                  },
                              .sendAway =
                                  [weak, streamsOf](const session::Session& session) {
                                    if (const auto context = weak.lock())
                                      streamsOf(*context, session, [](OpenStream& stream) { stream.postGoingAway(); });
                                  },
                              .leave =
                                  [weak] {
                                    if (const auto context = weak.lock()) drain(*context);
                                  }});
  }

  static void drain(ServerContext& context) {
    context.ready = context.takesStreams = false;
    // Not all at once, where meshes go first: each costs its next server some of a start.
    const auto streams = context.streams.all();
    const bool spreads = context.directory->resources().bus->server() != 0;
    const auto pause = spreads ? std::min(kBetweenStreams, context.settings.drain / static_cast<int>(2 * streams.size() + 1)) : 0ms;
    auto after = 0ms;
    for (const auto& stream : streams) stream->postGoingAway(std::exchange(after, after + pause));
  }

  std::optional<Error> reloadAll() {
    const Settings& settings = shared_->settings;
    std::shared_ptr<TlsContext> tls;
    if (!settings.tlsCertificate.empty()) {
      auto loaded = transport::loadTls(settings.tlsCertificate, settings.tlsKey);
      if (!loaded) return loaded.error();
      tls = std::move(*loaded);
    }
    const auto keysChanged = [weak = std::weak_ptr(shared_)] {
      if (const auto shared = weak.lock())
        for (const auto& stream : shared->streams.all()) stream->postJudge();
    };
    std::vector<std::string> withdrawn;
    if (auto error = shared_->filter.load(&withdrawn, keysChanged)) return error;
    withdrawals_->loaded(withdrawn);
    {
      const std::lock_guard lock(shared_->tlsMutex);
      shared_->tlsOfNew = std::move(tls);
    }
    for (const auto& stream : shared_->streams.all()) stream->postJudge();
    return {};
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

  // Checks everything that limits connections before anything is made for this one.
  void take(tcp::socket&& socket) {
    const Settings& settings = shared_->settings;
    shared_->figures->connections.Increment();
    error_code gone;
    const tcp::endpoint peer = socket.remote_endpoint(gone);
    if (gone) return;
    const access::Address address = addressOf(peer);
    const auto isProxy = [&](const access::Network& network) { return network.contains(address); };
    auto kind = ConnectionSlot::Kind::kServed;
    std::optional<access::ConnectionsByAddress::Place> place;
    if (shared_->connections->served >= settings.maxConnections) {
      kind = ConnectionSlot::Kind::kTooMany;
    } else if (std::none_of(settings.trustedProxies.begin(), settings.trustedProxies.end(), isProxy)) {
      place = shared_->connections->byAddress.enter(address);
      if (!place) kind = ConnectionSlot::Kind::kTooManyOfAddress;
    }
    if (kind != ConnectionSlot::Kind::kServed) {
      shared_->figures->refused(kind == ConnectionSlot::Kind::kTooMany ? metrics::Refusal::kConnections : metrics::Refusal::kAddress);
      if (shared_->connections->turned >= kTurnedAtATime) return;
    }
    startHttp(std::move(socket), ConnectionSlot(shared_->connections, kind, std::move(place)), shared_);
  }

  void takeAdmin(tcp::socket&& socket) {
    if (shared_->connections->admins < kAdminsAtATime)
      startHttp(std::move(socket), ConnectionSlot(shared_->connections, ConnectionSlot::Kind::kAdmin, {}), shared_);
  }

  std::shared_ptr<ServerContext> shared_;
  asio::io_context io_;
  Listener listener_, adminListener_;
  std::shared_ptr<Withdrawals> withdrawals_;
  std::vector<std::thread> threads_;
};

}  // namespace

Outcome<std::unique_ptr<Server>> Server::listen(const Settings& settings, std::shared_ptr<directory::Directory> directory,
                                                std::vector<Route> routes) {
  auto server = std::make_unique<ListeningServer>(settings, std::move(directory), std::move(routes));
  if (auto error = server->open()) return std::move(*error);
  return std::unique_ptr<Server>(std::move(server));
}

}  // namespace ridgecast::net
