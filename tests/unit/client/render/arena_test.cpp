// Laws of the arena: ranges never overlap, stay inside, and what is given back can be taken again.
#include "client/render/arena.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace ridgecast::render {
namespace {

TEST(Arena, HandsOutDisjointRangesAndJoinsThemAgain) {
  std::mt19937 random(7);
  Arena arena(0);
  std::vector<bool> taken;
  std::vector<std::pair<std::size_t, std::size_t>> held;
  for (int step = 0; step < 20000; ++step) {
    if (held.empty() || random() % 100 < 55) {
      const std::size_t size = 1 + random() % 40;
      auto start = arena.take(size);
      if (!start) {
        // Refused only when no gap is long enough.
        std::size_t run = 0, longest = 0;
        for (const bool t : taken) longest = std::max(longest, run = t ? 0 : run + 1);
        ASSERT_LT(longest, size);
        arena.grow(std::max<std::size_t>(2 * arena.capacity(), 64));
        taken.resize(arena.capacity(), false);
        start = arena.take(size);
      }
      ASSERT_TRUE(start);
      ASSERT_LE(*start + size, arena.capacity());
      for (std::size_t k = *start; k < *start + size; ++k) {
        ASSERT_FALSE(taken[k]);
        taken[k] = true;
      }
      held.emplace_back(*start, size);
    } else {
      const std::size_t which = random() % held.size();
      const auto [start, size] = held[which];
      held[which] = held.back();
      held.pop_back();
      arena.giveBack(start, size);
      for (std::size_t k = start; k < start + size; ++k) taken[k] = false;
    }
    std::size_t sum = 0;
    for (const auto& [start, size] : held) sum += size;
    ASSERT_EQ(arena.used(), sum);
  }
  for (const auto& [start, size] : held) arena.giveBack(start, size);
  EXPECT_EQ(arena.used(), 0u);
  EXPECT_EQ(arena.take(arena.capacity()), 0u);  // one gap again
  EXPECT_FALSE(arena.take(1));
}

}  // namespace
}  // namespace ridgecast::render
