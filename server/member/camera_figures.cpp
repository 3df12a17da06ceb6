#include "server/member/camera_figures.h"

#include <chrono>
#include <optional>

namespace ridgecast::member {

void CameraFigures::arrived(std::uint64_t pose) {
  const std::lock_guard lock(mutex_);
  if (arrivals_.size() >= kMaxArrivals) arrivals_.pop_front();
  arrivals_.emplace_back(pose, timer_.now());
}

void CameraFigures::holds(std::uint32_t triangles, metrics::Withheld by) {
  const std::lock_guard lock(mutex_);
  all_->triangles.Increment(static_cast<double>(triangles) - triangles_);
  const auto count = [&](metrics::Withheld what, double one) {
    if (what != metrics::Withheld::kNone) all_->withheld[static_cast<std::size_t>(what) - 1]->Increment(one);
  };
  count(withheld_, -1);
  count(by, 1);
  triangles_ = triangles;
  withheld_ = by;
}

std::shared_ptr<const void> CameraFigures::sent(std::uint64_t pose, bool late) {
  all_->iterationsSent.Increment();
  if (late) all_->iterationsLate.Increment();
  std::optional<scheduling::Timer::Time> arrival;
  const std::lock_guard lock(mutex_);
  for (; !arrivals_.empty() && arrivals_.front().first <= pose; arrivals_.pop_front()) arrival = arrivals_.front().second;
  if (!arrival) return nullptr;  // a further iteration for a pose
  return {nullptr, [all = all_, arrival = *arrival](const void*) {
            all->delivery.Observe(std::chrono::duration<double>(std::chrono::steady_clock::now() - arrival).count());
          }};
}

}  // namespace ridgecast::member
