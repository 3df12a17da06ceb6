#pragma once
// Packed edits (packed.h) in order, in consecutive blocks, and for each how many of its undos count: 8 more bytes an edit. Running out of
// memory throws and changes nothing.

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace ridgecast::edits {

class Entries {
 public:
  std::size_t size() const { return size_; }
  std::string_view packed(std::size_t k) const;  // until an edit is added or removed
  std::uint32_t& undos(std::size_t k) { return blockOf(k).undos[k % kBlock]; }
  std::uint32_t undos(std::size_t k) const { return blockOf(k).undos[k % kBlock]; }
  void add(std::string_view packed, std::uint32_t undos = 0);
  void removeLast();

 private:
  static constexpr std::size_t kBlock = 256;  // edits
  struct Block {
    std::string bytes;
    std::array<std::uint32_t, kBlock> ends{}, undos{};
    std::size_t begin(std::size_t k) const { return k == 0 ? 0 : ends[k - 1]; }
  };
  Block& blockOf(std::size_t k) const { return *blocks_[k / kBlock]; }
  std::vector<std::unique_ptr<Block>> blocks_;
  std::size_t size_ = 0;
};

}  // namespace ridgecast::edits
