#pragma once
// How many bytes the edits of a server may take: in memory those that wait to be made; on disk those of live sessions, whose operations the
// ground's history also has in memory. Any thread.

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "common/outcome/contract.h"

namespace ridgecast::editing {

class EditSpace {
 public:
  struct Limits {
    std::uint64_t session = std::uint64_t{256} << 20, server = std::uint64_t{1} << 30;  // bytes, as edit_store::Applied::bytes
    std::uint64_t waiting = 8u << 20, allWaiting = 64u << 20;  // of a session, of which one client has half; of all
  };
  EditSpace() = default;
  explicit EditSpace(const Limits& l) : limits(l) {}

  // At most `most` bytes at once. False: too few are left.
  class Share {
   public:
    bool take(std::uint64_t bytes, std::uint64_t most) {
      if (used_.fetch_add(bytes) + bytes <= most) return true;
      used_ -= bytes;
      return false;
    }
    void give(std::uint64_t bytes) { expects(used_.fetch_sub(bytes) >= bytes, "what is given back was taken"); }
    std::uint64_t used() const { return used_; }

   private:
    std::atomic<std::uint64_t> used_{0};
  };

  const Limits limits{};
  Share kept, waiting;  // of limits.server and allWaiting
};

}  // namespace ridgecast::editing
