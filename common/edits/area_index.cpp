#include "common/edits/area_index.h"

#include <algorithm>
#include <bit>

#include "common/outcome/contract.h"

namespace ridgecast::edits {

int AreaIndex::sizeOf(const Posts& area) {
  const auto side = static_cast<std::uint64_t>(std::max(area.x1 - area.x0, area.z1 - area.z0));
  return std::max(0, static_cast<int>(std::bit_width(side - 1)) - kMinBits);
}

void AreaIndex::add(std::uint32_t edit, const Posts& area) {
  expects(!area.empty(), "an edit that is filed has an area");
  const int size = sizeOf(area), bits = kMinBits + size;
  const CellAddress cell{area.x0 >> bits, area.z0 >> bits};
  const auto narrow = [](std::int64_t v) { return static_cast<std::uint16_t>(v); };
  sizes_.at(static_cast<std::size_t>(size))[cell].push_back(
      {edit, narrow(area.x0 - (cell.i << bits)), narrow(area.z0 - (cell.j << bits)), narrow(area.x1 - area.x0), narrow(area.z1 - area.z0)});
}

void AreaIndex::remove(std::uint32_t edit, const Posts& area) {
  const int size = sizeOf(area), bits = kMinBits + size;
  Cells& cells = sizes_.at(static_cast<std::size_t>(size));
  const auto cell = cells.find({area.x0 >> bits, area.z0 >> bits});
  expects(cell != cells.end(), "an edit that is taken out was filed");
  std::vector<Filed>& filed = cell->second;
  const auto last = std::find_if(filed.rbegin(), filed.rend(), [edit](const Filed& f) { return f.edit == edit; });
  expects(last != filed.rend(), "an edit that is taken out was filed");
  filed.erase(std::prev(last.base()));
  if (filed.empty()) cells.erase(cell);
}

std::size_t AreaIndex::forEach(const Posts& posts, const std::function<void(std::uint32_t edit, const Posts& area)>& f) const {
  std::size_t looked = 0;
  for (int size = 0; size < kSizes; ++size) {
    const Cells& cells = sizes_[static_cast<std::size_t>(size)];
    const int bits = kMinBits + size;
    const auto inCell = [&](const CellAddress& at, const std::vector<Filed>& all) {
      looked += all.size();
      for (const Filed& filed : all) {
        const std::int64_t x = (at.i << bits) + filed.x, z = (at.j << bits) + filed.z;
        if (const Posts area{x, z, x + filed.columns, z + filed.rows}; area.meets(posts)) f(filed.edit, area);
      }
    };
    // An area reaches less than a cell beyond its own.
    const std::int64_t i0 = (posts.x0 >> bits) - 1, i1 = (posts.x1 - 1) >> bits, j0 = (posts.z0 >> bits) - 1, j1 = (posts.z1 - 1) >> bits;
    const auto wanted = static_cast<std::uint64_t>(i1 - i0 + 1) * static_cast<std::uint64_t>(j1 - j0 + 1);
    if (wanted > cells.size()) {
      for (const auto& [at, all] : cells)
        if (at.i >= i0 && at.i <= i1 && at.j >= j0 && at.j <= j1) inCell(at, all);
      continue;
    }
    for (std::int64_t j = j0; j <= j1; ++j)
      for (std::int64_t i = i0; i <= i1; ++i)
        if (const auto cell = cells.find({i, j}); cell != cells.end()) inCell(cell->first, cell->second);
  }
  return looked;
}

}  // namespace ridgecast::edits
