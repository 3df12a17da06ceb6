#pragma once
// Shared by the connections of one server. Private to the room; light except for Boost.Asio.

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include <boost/asio/ip/tcp.hpp>

#include "common/outcome/contract.h"
#include "common/transport/channel.h"
#include "server/access/limits.h"
#include "server/directory/directory.h"
#include "server/http/request_filter.h"
#include "server/net/request_body_budget.h"
#include "server/net/server.h"
#include "server/session/session.h"

namespace ridgecast::net {

using namespace ridgecast::http;
using ridgecast::transport::Channel;
using ridgecast::transport::TlsContext;

inline constexpr char kServerName[] = "ridgecast-server/" RIDGECAST_VERSION;

// An open stream, as seen by the server.
class OpenStream {
 public:
  virtual ~OpenStream() = default;
  // Any thread. The camera's mesh goes first (member::CameraSession::handOver), if it can, beginning after this time.
  virtual void postGoingAway(std::chrono::milliseconds after = {}) = 0;
  virtual void postJudge() = 0;  // ends the stream if its token is withdrawn
  // Ends the stream for the operator, if it is this camera's; nothing: any camera's.
  virtual void postRemove(std::optional<std::uint64_t> camera) = 0;
  virtual std::size_t waitingBytes() const = 0;
  virtual const session::Session& session() const = 0;
};

// Streams that are open. Any thread.
class OpenStreams {
 public:
  void add(const std::shared_ptr<OpenStream>& stream) {
    const std::lock_guard lock(mutex_);
    expects(streams_.emplace(stream.get(), stream).second, "a stream is opened once");
  }
  void remove(const OpenStream* stream) {
    const std::lock_guard lock(mutex_);
    streams_.erase(stream);
    removed_.notify_all();
  }
  std::vector<std::shared_ptr<OpenStream>> all() const {
    std::vector<std::shared_ptr<OpenStream>> streams;
    const std::lock_guard lock(mutex_);
    for (const auto& [key, weak] : streams_)
      if (auto stream = weak.lock()) streams.push_back(std::move(stream));
    return streams;
  }
  void awaitNone(std::chrono::steady_clock::time_point until) {
    std::unique_lock lock(mutex_);
    removed_.wait_until(lock, until, [this] { return streams_.empty(); });
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable removed_;
  std::unordered_map<const OpenStream*, std::weak_ptr<OpenStream>> streams_;
};

// Computed bodies until they are sent. Any thread.
class UnsentBytes : public std::enable_shared_from_this<UnsentBytes> {
 public:
  // Counts them while the result lives.
  std::shared_ptr<const void> count(std::size_t bytes) {
    bytes_ += bytes;
    return {nullptr, [self = shared_from_this(), bytes](std::nullptr_t) {
              const std::lock_guard lock(self->mutex_);
              expects(self->bytes_.fetch_sub(bytes) >= bytes, "an answer that is sent was counted");
              self->sent_.notify_all();
            }};
  }
  std::size_t bytes() const { return bytes_; }
  void awaitNone(std::chrono::steady_clock::time_point until) {
    std::unique_lock lock(mutex_);
    sent_.wait_until(lock, until, [this] { return bytes_ == 0; });
  }

 private:
  std::atomic<std::size_t> bytes_{0};
  std::mutex mutex_;
  std::condition_variable sent_;
};

// A queue of work for answers.
struct Work {
  Work(const Jobs::Limits& limits, const metrics::Metrics::Work& f) : jobs(limits), figures(f) {}
  Jobs jobs;
  const metrics::Metrics::Work figures;
};

// Connections that are open. Any thread.
struct Connections {
  explicit Connections(std::uint32_t maxPerAddress) : byAddress(maxPerAddress) {}
  access::ConnectionsByAddress byAddress;
  std::atomic<std::uint32_t> served{0};
  std::atomic<std::uint32_t> turned{0};  // over a limit, which only get a refusal
  std::atomic<std::uint32_t> admins{0};  // of the admin port
};

// How the keys of the tokens' issuer are fetched; empty: it has no URL.
access::IssuerKeys::Fetch keysOf(const access::Files& files);

// Shared by all connections. Outlives them.
struct ServerContext {
  ServerContext(const Settings& s, std::shared_ptr<directory::Directory> d, std::vector<Route> r)
      : settings(s),
        directory(std::move(d)),
        routes(std::move(r)),
        figures(directory->resources().figures),
        filter(settings, keysOf(settings.tokens)),
        connections(std::make_shared<Connections>(settings.maxConnectionsPerAddress)),
        queues{{{s.promptJobs, figures->work("answers")},
                {s.tileJobs, figures->work("tiles")},
                {s.patientJobs, figures->work("snapshots")},
                {s.worldJobs, figures->work("worlds")}}} {}
  Work& work(Queue queue) { return queues[static_cast<std::size_t>(queue)]; }
  std::shared_ptr<TlsContext> tls() const {
    const std::lock_guard lock(tlsMutex);
    return tlsOfNew;
  }

  const Settings settings;
  const std::shared_ptr<directory::Directory> directory;
  std::vector<Route> routes;  // constant once connections are accepted
  const std::shared_ptr<metrics::Metrics> figures;
  RequestFilter filter;
  const std::shared_ptr<Connections> connections;
  std::atomic<bool> ready{true};         // false: /readyz says that it leaves
  std::atomic<bool> takesUp{false};      // true: /readyz says that it reads what other servers have made
  std::atomic<bool> takesStreams{true};  // false: new ones are refused
  std::atomic<bool> reloaded{true};      // the last reload succeeded
  OpenStreams streams;
  std::array<Work, 4> queues;  // by http::Queue
  const std::shared_ptr<UnsentBytes> unsent = std::make_shared<UnsentBytes>();
  const std::shared_ptr<RequestBodyBudget> bodies = std::make_shared<RequestBodyBudget>();
  mutable std::mutex tlsMutex;
  std::shared_ptr<TlsContext> tlsOfNew;  // for new connections; null: no TLS
};

// Counts a connection while it lives.
class ConnectionSlot {
 public:
  // Of connections over a limit, at most kTurnedAtATime get an answer.
  enum class Kind { kServed, kTooMany, kTooManyOfAddress, kAdmin };

  // `place`: among the connections of its address. Empty behind a proxy, whose clients are counted by request.
  ConnectionSlot(std::shared_ptr<Connections> all, Kind kind, std::optional<access::ConnectionsByAddress::Place> place)
      : all_(std::move(all)), kind_(kind), place_(std::move(place)) {
    ++number();
  }
  ConnectionSlot(ConnectionSlot&&) = default;
  ConnectionSlot& operator=(ConnectionSlot&&) = delete;
  ~ConnectionSlot() {
    if (all_) expects(number()-- > 0, "a connection that ends was counted");
  }
  Kind kind() const { return kind_; }
  // Whose connection it is, for kServed: the token's holder or, without a token, the household of the address.
  std::string client(const access::Grant& grant) const {
    expects(!grant.name.empty() || place_, "a client without a token is known by its address");
    return grant.name.empty() ? "address " + access::toText(place_->who()) : "token of " + grant.name;
  }
  // Counts the connection for this client from now on. False: the client has too many.
  bool belongsTo(const access::Address& client) {
    if (place_ && place_->who() == access::household(client)) return true;
    place_.reset();
    place_ = all_->byAddress.enter(client);
    return place_.has_value();
  }

 private:
  std::atomic<std::uint32_t>& number() const {
    return kind_ == Kind::kServed ? all_->served : kind_ == Kind::kAdmin ? all_->admins : all_->turned;
  }

  std::shared_ptr<Connections> all_;
  Kind kind_;
  std::optional<access::ConnectionsByAddress::Place> place_;
};

// ADDRESS:PORT, [ADDRESS]:PORT
std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint);
access::Address addressOf(const boost::asio::ip::tcp::endpoint& endpoint);

}  // namespace ridgecast::net
