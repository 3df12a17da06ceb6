#pragma once
// How many cameras a server has at most, and how many triangles are set aside for each.
//
// A camera has at least settings::kMinBudget. Beyond that it is granted what is left after reserving as much for every camera that may
// still come (at most half of all). What a camera was granted stays set aside until it ends: its mesh keeps its memory. A camera that was
// granted less than it requested is granted more when others have ended (member/camera_session.h).

#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>

#include "common/outcome/outcome.h"

namespace ridgecast::session {

// Any thread.
class CameraQuota : public std::enable_shared_from_this<CameraQuota> {
 public:
  CameraQuota(std::uint32_t cameras, std::uint64_t triangles) : maxCameras_(cameras), maxTriangles_(triangles) {}  // triangles 0: unlimited

  // One camera's share; given back when destroyed.
  class Share {
   public:
    explicit Share(std::shared_ptr<CameraQuota> quota) : quota_(std::move(quota)) {}
    ~Share();
    Share(const Share&) = delete;
    Share& operator=(const Share&) = delete;
    // The budget for a camera that requests this one: the same or less.
    std::uint32_t grant(std::uint32_t requested);
    // What grant() would return.
    std::uint32_t offer(std::uint32_t requested) const;

   private:
    friend class CameraQuota;
    std::uint32_t offerNow(std::uint32_t requested) const;  // under the lock
    const std::shared_ptr<CameraQuota> quota_;
    std::uint64_t triangles_ = 0;  // set aside; under the lock
  };
  // Error: there are as many cameras as there may be, or no triangles are left for another.
  Outcome<std::shared_ptr<Share>> take();
  std::uint32_t cameras() const;
  std::uint64_t triangles() const;  // set aside for all

 private:
  const std::uint32_t maxCameras_;
  const std::uint64_t maxTriangles_;
  mutable std::mutex mutex_;
  std::uint32_t cameras_ = 0;
  std::uint64_t triangles_ = 0;  // set aside
};

}  // namespace ridgecast::session
