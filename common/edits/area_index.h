#pragma once
// Finds the edits that may touch some ground, by their areas, each filed once by its size and corner. 12 bytes an edit where many are close
// together.

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <unordered_map>
#include <vector>

#include "common/edits/layer.h"
#include "common/edits/operation.h"

namespace ridgecast::edits {

class AreaIndex {
 public:
  void add(std::uint32_t edit, const Posts& area);     // an operation's; not empty
  void remove(std::uint32_t edit, const Posts& area);  // as it was added; quick if that was lately
  // Those whose areas meet the posts, in no order. Returns how many areas were examined, 2 ns each.
  std::size_t forEach(const Posts& posts, const std::function<void(std::uint32_t edit, const Posts& area)>& f) const;

 private:
  // Cells of the smallest size have 256 posts a side, those of the next twice that: up to 16,384, more than any area's side.
  static constexpr int kMinBits = 8, kSizes = 7;
  struct Filed {
    std::uint32_t edit;
    std::uint16_t x, z, columns, rows;  // posts, of the corner from that of the cell
  };
  using Cells = std::unordered_map<CellAddress, std::vector<Filed>, HashOfCell>;
  static int sizeOf(const Posts& area);
  std::array<Cells, kSizes> sizes_;
};

}  // namespace ridgecast::edits
