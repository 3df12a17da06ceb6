#include "server/scheduling/colouring.h"

#include <algorithm>
#include <bit>
#include <numeric>

#include "common/outcome/contract.h"

namespace ridgecast::scheduling {

Colouring colour(std::span<const std::span<const std::uint32_t>> writeSets, std::size_t places) {
  thread_local std::vector<std::uint64_t> used;  // by place: the colours of tasks that may write it
  used.assign(places, 0);
  std::vector<int> colours;
  for (const auto& set : writeSets) {
    std::uint64_t taken = 0;
    for (std::uint32_t p : set) {
      expects(p < places, "tasks write to places that are there");
      taken |= used[p];
    }
    colours.push_back(std::min(63, std::countr_one(taken)));
    for (std::uint32_t p : set) used[p] |= std::uint64_t{1} << colours.back();
  }
  Colouring result;
  result.tasks.resize(writeSets.size());
  std::iota(result.tasks.begin(), result.tasks.end(), 0u);
  std::stable_sort(result.tasks.begin(), result.tasks.end(), [&](std::uint32_t a, std::uint32_t b) { return colours[a] < colours[b]; });
  result.order.resize(writeSets.size());
  thread_local std::vector<std::uint32_t> last;  // by place: 1 + the last task so far that may write it; 0: none
  last.assign(places, 0);
  for (std::uint32_t k = 0; k < result.tasks.size(); ++k) {
    auto& before = result.order[k];
    for (std::uint32_t p : writeSets[result.tasks[k]]) {
      if (last[p] != 0) before.push_back(last[p] - 1);
      last[p] = k + 1;
    }
    std::sort(before.begin(), before.end());
    before.erase(std::unique(before.begin(), before.end()), before.end());
  }
  return result;
}

}  // namespace ridgecast::scheduling
