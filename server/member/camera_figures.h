#pragma once
// One camera's share of the server's figures. Any thread.

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <utility>

#include "server/metrics/metrics.h"
#include "server/scheduling/timer.h"

namespace ridgecast::member {

class CameraFigures {
 public:
  CameraFigures(std::shared_ptr<metrics::Metrics> all, const scheduling::Timer& timer) : all_(std::move(all)), timer_(timer) {}
  CameraFigures(const CameraFigures&) = delete;
  CameraFigures& operator=(const CameraFigures&) = delete;
  ~CameraFigures() { holds(0, metrics::Withheld::kNone); }

  void arrived(std::uint64_t pose);
  // The mesh's triangles now, and what withholds detail.
  void holds(std::uint32_t triangles, metrics::Withheld by);
  // An iteration for this pose is sent; the message's ticket (sender.h) tells when it has left. Late: a newer pose has come.
  std::shared_ptr<const void> sent(std::uint64_t pose, bool late);

 private:
  static constexpr std::size_t kMaxArrivals = 64;

  const std::shared_ptr<metrics::Metrics> all_;
  const scheduling::Timer& timer_;
  std::mutex mutex_;
  std::uint32_t triangles_ = 0;
  metrics::Withheld withheld_ = metrics::Withheld::kNone;
  std::deque<std::pair<std::uint64_t, scheduling::Timer::Time>>
      arrivals_;  // of poses without an iteration yet; at most kMaxArrivals, the newest
};

}  // namespace ridgecast::member
