#pragma once
// Places for a server's cameras, and the triangles set aside for each.
//
// A camera has at least settings::kLeastBudget. Beyond that it is granted what is left once as much is kept for every camera that may still
// come; at most half of all is kept for those. What a camera was once granted stays set aside until it ends: its mesh keeps its memory.

#include <cstdint>
#include <memory>
#include <mutex>

#include "common/outcome/outcome.h"

namespace ridgecast::session {

// Any thread.
class Places : public std::enable_shared_from_this<Places> {
 public:
  Places(std::uint32_t cameras, std::uint64_t triangles) : maxCameras_(cameras), maxTriangles_(triangles) {}  // triangles 0: unlimited

  // One camera's place; given back when destroyed.
  class Place {
   public:
    explicit Place(std::shared_ptr<Places> places) : places_(std::move(places)) {}
    ~Place();
    Place(const Place&) = delete;
    Place& operator=(const Place&) = delete;
    // The budget for a camera that requests this one: the same or less.
    std::uint32_t grant(std::uint32_t requested);

   private:
    friend class Places;
    const std::shared_ptr<Places> places_;
    std::uint64_t triangles_ = 0;  // set aside; under the lock
  };
  // Error: there are as many cameras as there may be, or no triangles are left for another.
  Outcome<std::shared_ptr<Place>> enter();
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
