#pragma once
// What the connections of one server share. For the room's own sources; light but for Boost.Asio.

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

#include "common/transport/channel.h"
#include "server/access/limits.h"
#include "server/http/gate.h"
#include "server/net/server.h"
#include "server/session/session.h"

namespace ridgecast::net {

using ridgecast::http::Answer;
using ridgecast::http::Gate;
using ridgecast::http::Jobs;
using ridgecast::http::kSubprotocol;
using ridgecast::http::Later;
using ridgecast::http::namesEtag;
using ridgecast::http::queryParameter;
using ridgecast::http::Request;
using ridgecast::http::Route;
using ridgecast::transport::Channel;
using ridgecast::transport::loadTls;
using ridgecast::transport::TlsContext;

inline constexpr char kServerName[] = "ridgecast-server/" RIDGECAST_VERSION;

// An open stream, as the server sees it.
class OpenStream {
 public:
  virtual ~OpenStream() = default;
  // Any thread.
  virtual void postGoingAway() = 0;
  virtual std::size_t waitingBytes() const = 0;
};

// What all connections share. Outlives them.
struct Shared {
  Shared(const Settings& s, std::shared_ptr<session::Directory> d, std::vector<Route> r)
      : settings(s),
        directory(std::move(d)),
        routes(std::move(r)),
        figures(directory->resources().figures),
        gate(settings),
        census(settings.maxConnectionsPerAddress),
        promptJobs(s.promptJobs),
        patientJobs(s.patientJobs),
        worldJobs(s.worldJobs) {}
  const Settings settings;
  const std::shared_ptr<session::Directory> directory;
  std::vector<Route> routes;  // constant once connections are accepted
  const std::shared_ptr<metrics::Figures> figures;
  Gate gate;
  access::Census census;
  std::atomic<bool> ready{true};         // false: no new streams
  std::atomic<std::uint32_t> turned{0};  // connections that are only told that there are too many
  std::atomic<std::uint32_t> connections{0};
  std::atomic<std::size_t> answerBytes{0};  // of bodies made by work, until they are sent
  Jobs promptJobs, patientJobs, worldJobs;

  std::mutex mutex;
  std::shared_ptr<TlsContext> tls;  // of new connections; none: the port is in the clear
  std::condition_variable fewer;    // streams, or answers on their way
  std::unordered_map<const OpenStream*, std::weak_ptr<OpenStream>> streams;
};

// Counts a connection for as long as it lives.
class Counted {
 public:
  // Why it is not served; at most kTurnedAtATime of these are told so.
  enum class Surplus { kNone, kConnections, kAddress };

  // `place`: among the connections of its address; nothing: behind a proxy, whose clients are counted when they ask.
  Counted(std::shared_ptr<Shared> shared, Surplus surplus, std::optional<access::Census::Place> place)
      : shared_(std::move(shared)), surplus_(surplus), place_(std::move(place)) {
    ++(surplus_ == Surplus::kNone ? shared_->connections : shared_->turned);
  }
  Counted(Counted&&) = default;
  Counted& operator=(Counted&&) = delete;
  ~Counted() {
    if (shared_) --(surplus_ == Surplus::kNone ? shared_->connections : shared_->turned);
  }
  Surplus surplus() const { return surplus_; }
  // The connection is this client's from now on. False: the client has too many.
  bool belongsTo(const access::Address& client) {
    if (place_ && place_->who() == access::household(client)) return true;
    place_.reset();
    place_ = shared_->census.enter(client);
    return place_.has_value();
  }

 private:
  std::shared_ptr<Shared> shared_;
  Surplus surplus_;
  std::optional<access::Census::Place> place_;
};

// ADDRESS:PORT, [ADDRESS]:PORT
std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint);
access::Address addressOf(const boost::asio::ip::tcp::endpoint& endpoint);

}  // namespace ridgecast::net
