// Whatever the sets, tasks that share a place run one after the other, in the order of their colours.
#include "server/scheduling/colouring.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace ridgecast::scheduling {
namespace {

Colouring colourAll(const std::vector<std::vector<std::uint32_t>>& sets, std::size_t places) {
  return colour(std::vector<std::span<const std::uint32_t>>(sets.begin(), sets.end()), places);
}

TEST(Colouring, DisjointTasksWaitForNothing) {
  const Colouring c = colourAll({{0, 1}, {2}, {3, 4}}, 5);
  EXPECT_EQ(c.tasks, (std::vector<std::uint32_t>{0, 1, 2}));
  for (const auto& before : c.order) EXPECT_TRUE(before.empty());
}

TEST(Colouring, TasksOfOneColourComeTogether) {
  const Colouring c = colourAll({{0, 1}, {1, 2}, {2, 3}, {3, 4}}, 5);  // a row: two colours
  EXPECT_EQ(c.tasks, (std::vector<std::uint32_t>{0, 2, 1, 3}));
  EXPECT_EQ(c.order, (Order{{}, {}, {0, 1}, {1}}));
}

TEST(Colouring, ATaskWaitsForEveryEarlierOneThatSharesAPlace) {
  std::mt19937 rng(5);
  for (int round = 0; round < 50; ++round) {
    const std::uint32_t places = 5 + rng() % 60;
    std::vector<std::vector<std::uint32_t>> sets(200);  // more than 64 colours where places are few
    for (auto& set : sets) {
      const std::set<std::uint32_t> different{static_cast<std::uint32_t>(rng() % places), static_cast<std::uint32_t>(rng() % places),
                                              static_cast<std::uint32_t>(rng() % places)};
      set.assign(different.begin(), different.end());
    }
    const Colouring c = colourAll(sets, places);
    auto tasks = c.tasks;
    std::sort(tasks.begin(), tasks.end());
    for (std::uint32_t k = 0; k < sets.size(); ++k) ASSERT_EQ(tasks[k], k);
    // after[k][j]: j is done before k starts
    std::vector<std::vector<bool>> after(sets.size(), std::vector<bool>(sets.size(), false));
    for (std::uint32_t k = 0; k < sets.size(); ++k)
      for (std::uint32_t b : c.order[k]) {
        ASSERT_LT(b, k);
        after[k][b] = true;
        for (std::uint32_t j = 0; j < b; ++j) after[k][j] = after[k][j] || after[b][j];
      }
    for (std::uint32_t k = 0; k < sets.size(); ++k)
      for (std::uint32_t j = 0; j < k; ++j) {
        const auto &a = sets[c.tasks[j]], &b = sets[c.tasks[k]];
        if (std::find_first_of(a.begin(), a.end(), b.begin(), b.end()) != a.end()) {
          ASSERT_TRUE(after[k][j]) << j << " and " << k;
        }
      }
  }
}

}  // namespace
}  // namespace ridgecast::scheduling
