#pragma once
// Shared by the connections of one server. Private to the room; light except for Boost.Asio.

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>

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

using ridgecast::http::Answer;
using ridgecast::http::BodyHandler;
using ridgecast::http::DeferredResponse;
using ridgecast::http::Jobs;
using ridgecast::http::kSubprotocol;
using ridgecast::http::namesEtag;
using ridgecast::http::plain;
using ridgecast::http::queryParameter;
using ridgecast::http::Queue;
using ridgecast::http::refused;
using ridgecast::http::Reply;
using ridgecast::http::Request;
using ridgecast::http::RequestFilter;
using ridgecast::http::RetryAt;
using ridgecast::http::Route;
using ridgecast::http::routeOf;
using ridgecast::http::Turn;
using ridgecast::http::Upgrade;
using ridgecast::transport::Channel;
using ridgecast::transport::loadTls;
using ridgecast::transport::TlsContext;

inline constexpr char kServerName[] = "ridgecast-server/" RIDGECAST_VERSION;

// An open stream, as seen by the server.
class OpenStream {
 public:
  virtual ~OpenStream() = default;
  // Any thread.
  virtual void postGoingAway() = 0;
  virtual void postJudge() = 0;  // ends the stream if its token is withdrawn
  // Ends the stream for the operator, if it is this camera's; nothing: any camera's.
  virtual void postRemove(std::optional<std::uint64_t> camera) = 0;
  virtual std::size_t waitingBytes() const = 0;
  virtual const session::Session& session() const = 0;
};

// A queue of work for answers.
struct Work {
  Work(const Jobs::Limits& limits, const metrics::Metrics::Work& f) : jobs(limits), figures(f) {}
  Jobs jobs;
  const metrics::Metrics::Work figures;
};

// Shared by all connections. Outlives them.
struct ServerContext {
  ServerContext(const Settings& s, std::shared_ptr<session::Directory> d, std::vector<Route> r)
      : settings(s),
        directory(std::move(d)),
        routes(std::move(r)),
        figures(directory->resources().figures),
        filter(settings),
        connectionsByAddress(settings.maxConnectionsPerAddress),
        queues{{{s.promptJobs, figures->work("answers")},
                {s.tileJobs, figures->work("tiles")},
                {s.patientJobs, figures->work("snapshots")},
                {s.worldJobs, figures->work("worlds")}}} {}
  Work& work(Queue queue) { return queues[static_cast<std::size_t>(queue)]; }

  const Settings settings;
  const std::shared_ptr<session::Directory> directory;
  std::vector<Route> routes;  // constant once connections are accepted
  const std::shared_ptr<metrics::Metrics> figures;
  RequestFilter filter;
  access::ConnectionsByAddress connectionsByAddress;
  std::atomic<bool> ready{true};         // as /readyz says
  std::atomic<bool> takesStreams{true};  // false: new ones are refused
  std::atomic<std::uint32_t> turned{0};  // connections over a limit, which only get a refusal
  std::atomic<std::uint32_t> connections{0};
  std::atomic<std::uint32_t> admins{0};     // connections of the admin port
  std::atomic<std::size_t> answerBytes{0};  // of computed bodies, until they are sent
  std::array<Work, 4> queues;               // by http::Queue
  const std::shared_ptr<RequestBodyBudget> bodies = std::make_shared<RequestBodyBudget>();
  std::atomic<bool> reloaded{true};          // the last reload succeeded
  std::atomic<double> certificateExpiry{0};  // seconds since 1970; 0: no TLS

  std::mutex mutex;
  std::shared_ptr<TlsContext> tls;  // for new connections; null: no TLS
  std::condition_variable fewer;    // notified when there are fewer streams or answers
  std::unordered_map<const OpenStream*, std::weak_ptr<OpenStream>> streams;
};

// Counts a connection while it lives.
class ConnectionSlot {
 public:
  // Of connections over a limit, at most kTurnedAtATime get an answer.
  enum class Kind { kServed, kTooMany, kTooManyOfAddress, kAdmin };

  // `place`: among the connections of its address. Empty behind a proxy, whose clients are counted by request.
  ConnectionSlot(std::shared_ptr<ServerContext> shared, Kind kind, std::optional<access::ConnectionsByAddress::Place> place)
      : shared_(std::move(shared)), kind_(kind), place_(std::move(place)) {
    ++number();
  }
  ConnectionSlot(ConnectionSlot&&) = default;
  ConnectionSlot& operator=(ConnectionSlot&&) = delete;
  ~ConnectionSlot() {
    if (shared_) expects(number()-- > 0, "a connection that ends was counted");
  }
  Kind kind() const { return kind_; }
  // Whose connection it is, for kServed: the token's holder or, without a token, the household of the address.
  std::string client(const access::Grant& grant) const {
    return grant.name.empty() ? "address " + access::toText(place_->who()) : "token of " + grant.name;
  }
  // Counts the connection for this client from now on. False: the client has too many.
  bool belongsTo(const access::Address& client) {
    if (place_ && place_->who() == access::household(client)) return true;
    place_.reset();
    place_ = shared_->connectionsByAddress.enter(client);
    return place_.has_value();
  }

 private:
  std::atomic<std::uint32_t>& number() const {
    return kind_ == Kind::kServed ? shared_->connections : kind_ == Kind::kAdmin ? shared_->admins : shared_->turned;
  }

  std::shared_ptr<ServerContext> shared_;
  Kind kind_;
  std::optional<access::ConnectionsByAddress::Place> place_;
};

// ADDRESS:PORT, [ADDRESS]:PORT
std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint);
access::Address addressOf(const boost::asio::ip::tcp::endpoint& endpoint);

}  // namespace ridgecast::net
