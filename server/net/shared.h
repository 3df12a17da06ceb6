#pragma once
// What the connections of one server share. For the room's own sources; light but for Boost.Asio.

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <utility>

#include <boost/asio/ip/tcp.hpp>

#include "server/net/server.h"
#include "server/session/session.h"

namespace ridgecast::net {

inline constexpr char kServerName[] = "ridgecast-server/" RIDGECAST_VERSION;

// An open stream, as the server sees it.
class OpenStream {
 public:
  virtual ~OpenStream() = default;
  virtual void postGoingAway() = 0;  // any thread
};

// What all connections share. Outlives them.
struct Shared {
  Shared(const Settings& s, std::shared_ptr<session::Directory> d, std::vector<Route> r)
      : settings(s), directory(std::move(d)), routes(std::move(r)), promptJobs(s.promptJobs), patientJobs(s.patientJobs) {}
  const Settings settings;
  const std::shared_ptr<session::Directory> directory;
  const std::vector<Route> routes;
  std::atomic<std::uint32_t> connections{0};
  std::atomic<std::size_t> answerBytes{0};  // of bodies made by work, until they are sent
  Jobs promptJobs, patientJobs;

  std::mutex mutex;
  std::condition_variable fewerStreams;
  std::unordered_map<const OpenStream*, std::weak_ptr<OpenStream>> streams;
};

// Counts a connection for as long as it lives.
class Counted {
 public:
  explicit Counted(std::shared_ptr<Shared> shared) : shared_(std::move(shared)), rank_(++shared_->connections) {}
  Counted(Counted&&) = default;
  Counted& operator=(Counted&&) = delete;
  ~Counted() {
    if (shared_) --shared_->connections;
  }
  std::uint32_t rank() const { return rank_; }

 private:
  std::shared_ptr<Shared> shared_;
  std::uint32_t rank_;
};

// ADDRESS:PORT, [ADDRESS]:PORT
std::string nameOf(const boost::asio::ip::tcp::endpoint& endpoint);

}  // namespace ridgecast::net
