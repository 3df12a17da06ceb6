#include "common/edits/packed.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::edits {
namespace {

using testing_support::m;

std::vector<Operation> operationsOfAllKinds() {
  constexpr lattice::Step kFar = lattice::Step{1} << 50;
  std::vector<Operation> out{{Raise{{-1, kFar}, 333, 77, -1025}, 0},
                             {Crater{{-kFar, -5}, 12345, 3}, 1},
                             {Level{{{kFar - 1, 2}}, 4097, -300, 77}, 2},
                             {Level{{{1, 2}, {30001, 2}, {3, 9999}}, 0, 300, 77}, 0},
                             {Smooth{{3, 4}, 500, 16}, 3},
                             {Road{{{1, 2, 0}, {3000, 4000, 0}}, false, 999, 5, 300}, 0},
                             {Road{{{1, 2, -7}, {3000, 4000, 8}}, true, 999, 5, 300}, 6},
                             {Stamp{{3, 4}, 2, 3, 16, {1, -2, 3, -4, kMaxRise, -kMaxRise}}, 8},
                             {Undo{~std::uint64_t{0}}, 0}};
  std::mt19937_64 random(1);
  for (int k = 0; k < testing_support::rounds(500); ++k) out.push_back(testing_support::randomOperation(random, {m(1e9), -m(4e12)}));
  return out;
}

Operation stampOf(std::uint32_t side, const std::function<std::int32_t(std::uint32_t x, std::uint32_t z)>& sample) {
  Stamp stamp{{0, 0}, side, side, 1, {}};
  for (std::uint32_t z = 0; z < side; ++z)
    for (std::uint32_t x = 0; x < side; ++x) stamp.samples.push_back(sample(x, z));
  return {stamp, 0};
}

TEST(PackedEdit, ComesBackAsItWas) {
  std::vector<std::string> all;
  for (const Operation& o : operationsOfAllKinds()) {
    ASSERT_TRUE(check(o)) << check(o).error().message;
    const std::string bytes = pack(o);
    const auto back = unpack(bytes);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(*back, o);
    EXPECT_LE(bytes.size(), 100u);
    all.push_back(bytes);
  }
  std::ranges::sort(all);
  EXPECT_EQ(std::ranges::adjacent_find(all), all.end()) << "others have other bytes";
}

TEST(PackedEdit, HeightsThatCountForNothingAreLeftOut) {
  Road road{{{1, 2, 0}, {3000, 4000, 0}}, false, 999, 5, 300};
  const std::string bytes = pack({road, 0});
  road.line[1].y = 77;
  EXPECT_EQ(pack({road, 0}), bytes);
}

// Of every prefix, every flipped bit and every longer text: an error, or a valid operation that has these bytes.
TEST(PackedEdit, DamageIsRefusedOrIsAnotherEdit) {
  int others = 0;
  const auto look = [&](const std::string& bytes) {
    const auto read = unpack(std::string(bytes));  // its own allocation
    others += read.has_value();
    EXPECT_TRUE(read ? check(*read) && pack(*read) == bytes : !read.error().message.empty());
  };
  for (const Operation& o : operationsOfAllKinds()) {
    std::string bytes = pack(o);
    for (std::size_t n = 0; n < bytes.size(); ++n) EXPECT_FALSE(unpack(std::string(bytes.substr(0, n))));
    EXPECT_FALSE(unpack(bytes + '\0'));
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << bit % 8));
      look(bytes);
      bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << bit % 8));
    }
  }
  EXPECT_GT(others, 100);
}

TEST(PackedEdit, StampsTakeLittle) {
  EXPECT_LE(pack(stampOf(256, [](auto, auto) { return 0; })).size(), 16u);
  const auto hill = stampOf(256, [](auto x, auto z) { return static_cast<std::int32_t>(900 * std::sin(x * 0.05) * std::cos(z * 0.03)); });
  EXPECT_LE(pack(hill).size(), 65'536u * 5 / 4);
  EXPECT_EQ(unpack(pack(hill)).value(), hill);
  std::mt19937_64 random(2);
  const auto rough = stampOf(256, [&](auto, auto) { return static_cast<std::int32_t>(random() % 1024); });
  EXPECT_LE(pack(rough).size(), 65'536u * 9 / 4);
  const auto worst = stampOf(256, [](auto x, auto z) { return (x + z) % 2 == 0 ? kMaxRise : -kMaxRise; });
  EXPECT_LE(pack(worst).size(), kMaxPackedBytes);
  EXPECT_EQ(unpack(pack(worst)).value(), worst);
}

TEST(PackedEdit, RefusesOtherFormsKindsAndNumbers) {
  const std::string bytes = pack({Undo{5}, 0});
  EXPECT_EQ(bytes, std::string("\1\6\5"));
  EXPECT_EQ(unpack("\2\6\5").error().message, "An edit's bytes have a form that is not known; this program reads form 1.");
  EXPECT_FALSE(unpack("\1\7\5")) << "no such kind";
  EXPECT_FALSE(unpack(std::string("\1\6\0", 3))) << "no such edit";
  EXPECT_FALSE(unpack(std::string("\1\6\x85\0", 4))) << "longer than need be";
  EXPECT_FALSE(unpack("\1\6\xff\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01"));
  EXPECT_FALSE(unpack("\1\2\xff\xff\xff\xff\x0f")) << "a polygon of four thousand million corners";
}

}  // namespace
}  // namespace ridgecast::edits
