#include "client/render/arena.h"

#include <iterator>

#include "common/outcome/contract.h"

namespace ridgecast::render {

std::optional<std::size_t> Arena::take(std::size_t size) {
  for (auto gap = free_.begin(); gap != free_.end(); ++gap) {
    const auto [start, length] = *gap;
    if (length < size) continue;
    free_.erase(gap);
    if (length > size) free_.emplace(start + size, length - size);
    used_ += size;
    return start;
  }
  return std::nullopt;
}

void Arena::giveBack(std::size_t start, std::size_t size) {
  expects(size <= used_, "what is given back was taken");
  used_ -= size;
  auto after = free_.lower_bound(start);
  expects(after == free_.end() || start + size <= after->first, "what is given back was not free");
  if (after != free_.end() && after->first == start + size) {
    size += after->second;
    after = free_.erase(after);
  }
  if (after != free_.begin()) {
    const auto before = std::prev(after);
    if (before->first + before->second == start) {
      before->second += size;
      return;
    }
  }
  free_.emplace_hint(after, start, size);
}

void Arena::grow(std::size_t capacity) {
  if (capacity <= capacity_) return;
  const std::size_t start = capacity_, size = capacity - capacity_;
  capacity_ = capacity;
  used_ += size;
  giveBack(start, size);
}

}  // namespace ridgecast::render
