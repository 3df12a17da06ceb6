#pragma once
// A flight without a window: the camera follows a path over a server's terrain, and an observer measures. Knows no pictures.
//
// In lock-step (one pose, one iteration), the same flight gives the same meshes on any machine, and ends with the connection. By the clock
// it continues with what is held while the connection is lost.

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <utility>

#include "client/link/client.h"
#include "common/camera/camera.h"
#include "common/camera/path.h"
#include "common/lattice/lattice.h"
#include "common/outcome/outcome.h"

namespace ridgecast::flight {

// An observer's error ends the flight. Its time does not count: the flight's clock stands still.
class Observer {
 public:
  // An iteration was applied. `t`: seconds of path time of its pose; `latencyMs`: from sending the pose to having its message.
  virtual Outcome<void> iterated(const link::Update& update, double t, double latencyMs) = 0;
  // The next place on the path was reached, and what came for it applied.
  virtual Outcome<void> reached() = 0;

 protected:
  ~Observer() = default;
};

struct Options {
  bool realtime = false;                     // by the clock instead of in lock-step
  double rate = 10;                          // lock-step: iterations a second of path time
  std::optional<double> seconds = {};        // only the beginning of the path
  double settleLimit = 120;                  // seconds of wall time to wait at the end
  std::uint32_t width = 1280, height = 720;  // pixels
};

class Flight {
 public:
  // Metres of the ground at a point; may wait for it.
  using Ground = std::function<Outcome<double>(lattice::Point)>;

  // `client` said hello with the pacing that options.realtime asks for. It and `observer` must outlive this.
  Flight(const Options& options, camera::Path path, link::Client& client, Ground ground, Observer& observer);

  // All of them return the observer's errors, the ground's, and in lock-step those of a server that is gone or does not answer.
  Outcome<void> place(double t);  // looks from there and sends nothing
  Outcome<void> fly();
  // Repeats the last pose until the server has nothing left to refine; false: the settle limit was reached first. By the clock, another
  // world on the server is an error; after entering that world, this may be called again.
  Outcome<bool> settle();

  const camera::Camera& camera() const { return camera_; }
  double t() const { return t_; }  // seconds of path time
  double duration() const { return duration_; }
  double seconds() const { return seconds_; }  // of wall time in which iterations ran

 private:
  using Clock = std::chrono::steady_clock;
  Outcome<void> send(double t);
  Outcome<void> take(const link::Update& update);
  Outcome<void> step(double t);
  Outcome<void> receiveFor(std::chrono::milliseconds time);

  const Options options_;
  const camera::Path path_;
  link::Client& client_;
  const Ground ground_;
  Observer& observer_;
  const double duration_;
  camera::Camera camera_;
  double t_ = 0, seconds_ = 0;
  std::uint64_t sequence_ = 0, settled_ = 0;                            // poses: the newest, the newest at rest
  std::map<std::uint64_t, std::pair<Clock::time_point, double>> sent_;  // pose -> when, path time; at most 4,096
};

}  // namespace ridgecast::flight
