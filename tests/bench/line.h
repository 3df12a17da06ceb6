#pragma once
// One camera's end of a stream, for benches: it parses what comes and acknowledges with the hash it was told, so that the load is the
// server's. Tests elsewhere hold the mesh. One thread; errors are thrown, for main() to tell.

#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/camera/camera.h"
#include "tests/bench/bench.h"

namespace ridgecast::bench {

class Line {
 public:
  // Connects to 127.0.0.1 and asks for the upgrade. `name`: for errors.
  Line(std::uint16_t port, std::string name, std::uint32_t triangleBudget, std::uint64_t bytesPerSecond = 0);
  ~Line();
  Line(const Line&) = delete;
  Line& operator=(const Line&) = delete;

  int socket() const { return socket_; }
  bool open() const { return open_; }                          // the upgrade was answered
  bool answered() const { return open_ && waiting_.empty(); }  // every pose sent so far has its iteration
  double age() const;                                          // seconds since it connected
  void pose(const camera::Camera& camera);
  // Reads what is there.
  void receive();
  // Counts from zero again.
  void restart();

  std::uint64_t iterations = 0, bytes = 0;
  double encodeMs = 0, totalMs = 0, coarseMs = 0;  // coarse: from the connection to the first iteration
  std::vector<double> latencies;                   // ms, from a pose to the first iteration for it
  std::vector<double> thresholds;                  // pixels, that each iteration's mesh kept
  bool settled = false;

 private:
  void take(std::span<const std::uint8_t> payload);
  void frame(int opcode, std::string_view payload);
  void write(std::string_view out);

  const std::string name_;
  const std::uint32_t triangleBudget_;
  const std::uint64_t bytesPerSecond_;
  const Clock opened_;
  int socket_ = -1;
  bool open_ = false;
  std::string in_;
  std::uint64_t sequence_ = 0;
  std::deque<std::pair<std::uint64_t, Clock>> waiting_;
};

}  // namespace ridgecast::bench
