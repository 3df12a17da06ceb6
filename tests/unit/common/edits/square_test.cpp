// Squares of posts: a layer cut into them and put together again is the same ground; and on edited ground all variants agree.
#include "common/edits/square.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <memory>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/terrain/variants.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::edits {
namespace {

using lattice::Point;
using lattice::Step;
using testing_support::m;

std::shared_ptr<const Layer> randomLayer(const std::shared_ptr<const terrain::Terrain>& base, Point middle, int operations, int seed) {
  std::mt19937_64 random(static_cast<std::uint64_t>(seed));
  History history(base);
  for (int k = 0; k < operations; ++k) {
    const auto prepared = history.prepare(testing_support::randomOperation(random, middle));
    EXPECT_TRUE(!prepared || history.add(*prepared));
  }
  return history.layer();
}

class Squares : public testing::TestWithParam<Step> {
 protected:
  const Point middle{GetParam(), -GetParam()};
  const std::shared_ptr<const terrain::Terrain> base = terrain::create("alpine", 1).value();
  const std::shared_ptr<const Layer> layer = randomLayer(base, middle, 60, 5);
};

TEST_P(Squares, MakeTheSameLayerAgainInAnyOrder) {
  auto squares = squaresAround(*layer, middle, 1000, 10'000);
  ASSERT_GE(squares.size(), 4u);
  std::mt19937_64 random(1);
  std::ranges::shuffle(squares, random);
  auto made = std::make_shared<const Layer>();
  for (const SquareAddress a : squares) {
    const SquareBytes bytes = encode(squareOf(*layer, a));
    const auto square = decodeSquare(bytes.rises, bytes.materials);
    ASSERT_TRUE(square) << square.error().message;
    ASSERT_TRUE(*square);
    made = withSquare(*made, a, &**square);
  }
  EXPECT_EQ(made->hash(), layer->hash());
  const EditedTerrain a(base, layer), b(base, made);
  for (int k = 0; k < 20'000; ++k) {
    const Point p{middle.x + static_cast<Step>(random() % m(300)) - m(150), middle.z + static_cast<Step>(random() % m(300)) - m(150)};
    float left = 0, right = 0;
    a.heights({&p.x, 1}, {&p.z, 1}, {&left, 1});
    b.heights({&p.x, 1}, {&p.z, 1}, {&right, 1});
    ASSERT_EQ(std::bit_cast<std::uint32_t>(left), std::bit_cast<std::uint32_t>(right));
    ASSERT_EQ(layer->materialAt(p), made->materialAt(p));
  }
  for (const SquareAddress s : squares) made = withSquare(*made, s, nullptr);
  EXPECT_TRUE(made->empty());
}

TEST_P(Squares, AreFoundNearestFirst) {
  const auto all = squaresAround(*layer, middle, 1000, 10'000);
  for (const TileAddress a : layer->addresses()) {
    if (layer->tile(a)->isZero()) continue;
    EXPECT_TRUE(std::ranges::count(all, SquareAddress{a.i >> 3, a.j >> 3}) == 1);
  }
  for (const SquareAddress a : all)
    EXPECT_TRUE(encode(squareOf(*layer, a)).rises.size() + encode(squareOf(*layer, a)).materials.size() > 0);
  const auto few = squaresAround(*layer, middle, 1000, 2);
  EXPECT_EQ(few, std::vector(all.begin(), all.begin() + 2));
  EXPECT_TRUE(squaresAround(*layer, {middle.x + m(5000), middle.z}, 1000, 10).empty());
  EXPECT_FALSE(squaresAround(*layer, {middle.x + m(5000), middle.z}, 5000, 10).empty());
}

TEST_P(Squares, EverySetOfInstructionsAgreesOnEditedGround) {
  const EditedTerrain edited(base, randomLayer(base, middle, 300, 7));
  std::mt19937_64 random(2);
  std::vector<Step> x(static_cast<std::size_t>(testing_support::rounds(100'000))), z(x.size());
  for (std::size_t k = 0; k < x.size(); ++k) {
    x[k] = middle.x + static_cast<Step>(random() % m(260)) - m(130);
    z[k] = middle.z + static_cast<Step>(random() % m(260)) - m(130);
  }
  std::vector<float> right(x.size()), own(x.size());
  edited.heights(x, z, right);
  for (const terrain::Variant& v : terrain::variants()) {
    v.terrain[0].heights(x.data(), z.data(), own.data(), x.size(), 1, nullptr);
    std::size_t raised = 0;
    for (std::size_t k = 0; k < x.size(); ++k) {
      terrain::CubicPlaces places;
      std::array<std::int32_t, 16> around;
      for (std::int64_t n = 0; n < 16; ++n)
        around[static_cast<std::size_t>(n)] = edited.layer()->riseAt((x[k] >> kPostBits) - 1 + n % 4, (z[k] >> kPostBits) - 1 + n / 4);
      float height = own[k];
      if (std::ranges::any_of(around, [](std::int32_t rise) { return rise != 0; })) {
        float rise = 0;
        places.set(0, around, static_cast<float>(x[k] & (kPostSteps - 1)), static_cast<float>(z[k] & (kPostSteps - 1)));
        v.cubicHeights(places, 1, 1.0f / kPostSteps, 1.0f / kPostSteps, &rise);
        height += rise;
        ++raised;
      }
      ASSERT_EQ(std::bit_cast<std::uint32_t>(height), std::bit_cast<std::uint32_t>(right[k])) << v.name;
    }
    EXPECT_GT(raised, x.size() / 4);
  }
}

INSTANTIATE_TEST_SUITE_P(Everywhere, Squares, testing::Values(Step{0}, m(1e9) + 77, m(4e12)));

TEST(SquareBytes, OfWhatIsNoneAreRefused) {
  Square square;
  square.rises[7] = -kMaxRise;
  square.materials[9] = kMaterials;
  const SquareBytes good = encode(square);
  ASSERT_TRUE(decodeSquare(good.rises, good.materials));
  EXPECT_EQ((*decodeSquare(good.rises, good.materials))->materials, square.materials);
  EXPECT_FALSE(*decodeSquare({}, {}));
  square.rises[8] = kMaxRise + 1;
  EXPECT_FALSE(decodeSquare(encode(square).rises, {}));
  square.materials[1] = kMaterials + 1;
  EXPECT_FALSE(decodeSquare(good.rises, encode(square).materials));
  for (std::size_t length = 1; length < good.rises.size(); ++length)
    EXPECT_FALSE(decodeSquare(std::span(good.rises).first(length), good.materials)) << length;
}

}  // namespace
}  // namespace ridgecast::edits
