#pragma once
// Opens a connection to a world and waits for it: the server may first have to compile the terrain. Internal to the room.

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "client/replica/client.h"

namespace ridgecast::viewer {

// A world that is connected to.
struct Link {
  connection::Url url;
  wire::Settings settings;
  std::unique_ptr<replica::Client> client;

  static Outcome<Link> open(const connection::Url& url, const wire::Settings& settings, const connection::Waiting& waiting = {});
};

// A connection being opened while the window stays responsive. Main thread only.
class Arrival {
 public:
  Arrival(const connection::Url& url, const wire::Settings& settings);
  ~Arrival();  // gives up at once, except on the look-up of a host name
  Arrival(const Arrival&) = delete;
  Arrival& operator=(const Arrival&) = delete;

  // The connection, or why there is none; returned once.
  std::optional<Outcome<Link>> take();
  double seconds() const;                      // since it began
  bool prepares() const { return prepares_; }  // the server has reported that it is making the world
  // "waiting for 127.0.0.1:7070 to prepare the terrain, 12 s"
  std::string describe() const;

 private:
  const std::string where_;
  const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
  std::stop_source stop_;
  std::atomic<bool> prepares_ = false;
  std::future<Outcome<Link>> link_;
};

}  // namespace ridgecast::viewer
