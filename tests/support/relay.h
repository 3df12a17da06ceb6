#pragma once
// A line between client and server on loopback that is as bad as wanted: delay, jitter, a rate, breaks. Bytes stay in order, as TCP keeps
// them; what waits on the line is bounded by the product of rate and delay (at least 64 KiB), then the relay stops reading.

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

namespace ridgecast::testing_support {

struct Line {
  std::chrono::microseconds delay{0};   // one way
  std::chrono::microseconds jitter{0};  // more, evenly spread, one way
  std::uint64_t bytesPerSecond = 0;     // each way, of all connections together; 0: no limit
};

class Relay {
 public:
  // Listens on a free port of loopback and passes connections on to `port`. Throws std::runtime_error.
  Relay(std::uint16_t port, const Line& line);
  ~Relay();
  Relay(const Relay&) = delete;
  Relay& operator=(const Relay&) = delete;

  std::uint16_t port() const;
  std::string url() const { return "ws://127.0.0.1:" + std::to_string(port()); }
  void breakAll();                  // resets every connection; new ones are taken as before
  void hold(bool held);             // nothing moves while held
  std::uint64_t bytesDown() const;  // from the server

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ridgecast::testing_support
