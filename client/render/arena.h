#pragma once
// Hands out ranges of a growing array (first fit; returned neighbours are joined): the bookkeeping of the mesh's two large buffers. Not
// thread-safe.

#include <cstddef>
#include <map>
#include <optional>

namespace ridgecast::render {

class Arena {
 public:
  explicit Arena(std::size_t capacity) : capacity_(capacity) {
    if (capacity) free_.emplace(0, capacity);
  }
  std::size_t capacity() const { return capacity_; }
  std::size_t used() const { return used_; }

  // The start of `size` >= 1 free elements; empty if no gap is that long: then call grow().
  std::optional<std::size_t> take(std::size_t size);
  // Takes back exactly a range from take().
  void giveBack(std::size_t start, std::size_t size);
  // Adds space at the end; `capacity` must not shrink.
  void grow(std::size_t capacity);

 private:
  std::map<std::size_t, std::size_t> free_;  // start -> length; no two touch
  std::size_t capacity_ = 0, used_ = 0;
};

}  // namespace ridgecast::render
