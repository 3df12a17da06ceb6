// The lattice's laws, checked against plain arithmetic.
#include "common/lattice/lattice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <vector>

namespace ridgecast::lattice {
namespace {

using Random = std::mt19937_64;
std::int64_t between(Random& random, std::int64_t low, std::int64_t high) {
  return std::uniform_int_distribution<std::int64_t>(low, high)(random);
}

LeafAddress anyAddress(Random& random, int lowest = 0, int highest = kMaxLevel) {
  const auto level = static_cast<std::int32_t>(between(random, lowest, highest));
  const std::int64_t limit = between(random, 0, 1) == 0 ? 5 : (kMaxPosition >> (kFinestSideBits + level)) - 1;
  return {level, between(random, -limit, limit), between(random, -limit, limit)};
}

TEST(Lattice, UnitsAgree) {
  EXPECT_EQ(kStepsPerMetre, std::ldexp(1.0, kStepBits));
  EXPECT_EQ(kStepsPerMetre * kMetresPerStep, 1.0);
  EXPECT_EQ((LeafAddress{0, 0, 0}.side()) * kMetresPerStep, 32.0);
  EXPECT_EQ((LeafAddress{kMaxLevel, 0, 0}.side()) * kMetresPerStep, 32'768.0);
}

TEST(Lattice, FloorAndRound) {
  EXPECT_EQ(floorTo(-1, 4), -16);
  EXPECT_EQ(floorTo(-16, 4), -16);
  EXPECT_EQ(floorTo(-17, 4), -32);
  EXPECT_EQ(floorTo(15, 4), 0);
  EXPECT_EQ(roundTo(-8, 4), 0);  // halves upwards
  EXPECT_EQ(roundTo(-9, 4), -16);
  EXPECT_EQ(roundTo(8, 4), 16);
  EXPECT_EQ(roundTo(7, 4), 0);
  EXPECT_EQ(roundTo(-3, 0), -3);
  Random random(1);
  for (int k = 0; k < 10'000; ++k) {
    const int bits = static_cast<int>(between(random, 0, 24));
    const Step size = Step{1} << bits,
               v = between(random, 0, 1) ? between(random, -3 * size, 3 * size) : between(random, -kMaxPosition, kMaxPosition);
    const Step low = floorTo(v, bits), near = roundTo(v, bits);
    EXPECT_TRUE(low <= v && v < low + size && low % size == 0);
    EXPECT_EQ(near % size, 0);
    EXPECT_TRUE(2 * (v - near) < size && 2 * (v - near) >= -size) << v << ' ' << bits;
  }
}

TEST(Lattice, EveryPointIsInExactlyOneLeafOfEachLevel) {
  Random random(2);
  for (int k = 0; k < 5'000; ++k) {
    const LeafAddress a = anyAddress(random);
    // On and around the corner, where a mistake would be.
    const Point p{a.x() + between(random, -2, 2), a.z() + between(random, -2, 2)};
    int owners = 0;
    for (std::int64_t di = -2; di <= 2; ++di)
      for (std::int64_t dj = -2; dj <= 2; ++dj) {
        const LeafAddress near{a.level, a.i + di, a.j + dj};
        const bool inSquare = p.x >= near.x() && p.x < near.x() + near.side() && p.z >= near.z() && p.z < near.z() + near.side();
        EXPECT_EQ(near.contains(p), inSquare);
        EXPECT_EQ(near == leafAt(p, a.level), inSquare);
        owners += inSquare;
      }
    EXPECT_EQ(owners, 1);
  }
}

TEST(Lattice, EveryCentroidIsInExactlyOneLeafOfEachLevel) {
  Random random(3);
  for (int k = 0; k < 5'000; ++k) {
    const LeafAddress a = anyAddress(random);
    // Sums of three coordinates around three times the corner: thirds of a step decide.
    const Step sumX = 3 * a.x() + between(random, -4, 4), sumZ = 3 * a.z() + between(random, -4, 4);
    int owners = 0;
    for (std::int64_t di = -1; di <= 1; ++di)
      for (std::int64_t dj = -1; dj <= 1; ++dj) owners += LeafAddress{a.level, a.i + di, a.j + dj}.containsCentroid(sumX, sumZ);
    EXPECT_EQ(owners, 1);
    // The centroid rule is the point rule where the centroid is a point, and agrees with the half-open square's floor elsewhere.
    const Point floor{sumX >= 0 ? sumX / 3 : -((-sumX + 2) / 3), sumZ >= 0 ? sumZ / 3 : -((-sumZ + 2) / 3)};
    EXPECT_TRUE(leafAt(floor, a.level).containsCentroid(sumX, sumZ));
  }
}

TEST(Lattice, ParentsAndChildren) {
  Random random(4);
  for (int k = 0; k < 5'000; ++k) {
    const LeafAddress a = anyAddress(random, 1);
    std::set<LeafAddress> children;
    for (int quadrant = 0; quadrant < 4; ++quadrant) {
      const LeafAddress child = a.child(quadrant);
      children.insert(child);
      EXPECT_EQ(child.parent(), a);
      EXPECT_EQ(child.x(), a.x() + (quadrant & 1) * child.side());
      EXPECT_EQ(child.z(), a.z() + (quadrant >> 1) * child.side());
      EXPECT_TRUE(a.isAncestorOf(child));
      EXPECT_FALSE(child.isAncestorOf(a));
    }
    EXPECT_EQ(children.size(), 4u);
    EXPECT_TRUE(a.isAncestorOf(a));
    const Point p{a.x() + between(random, 0, a.side() - 1), a.z() + between(random, 0, a.side() - 1)};
    for (int level = 0; level <= kMaxLevel; ++level) {
      EXPECT_EQ(a.isAncestorOf(leafAt(p, level)), level <= a.level);
      EXPECT_EQ(leafAt(p, level).isAncestorOf(a), level >= a.level);
    }
  }
}

TEST(Lattice, GridsOfLevelsNest) {
  for (int level = 1; level <= kMaxLevel; ++level) {
    EXPECT_GE(horizontalBits(level), horizontalBits(level - 1));
    EXPECT_GE(verticalBits(level), verticalBits(level - 1));
    EXPECT_LE(horizontalBits(level), LeafAddress({level, 0, 0}).sideBits() - 2) << "a leaf's own first grid of 3 x 3 must lie on it";
  }
  EXPECT_EQ(snapHeight(37, 0), 37);
  EXPECT_EQ(snapHeight(-9, 1), -16);
  EXPECT_EQ(snapHeight(-8, 1), 0);
}

TEST(Lattice, ValidityEndsAtTheEdge) {
  EXPECT_TRUE(positionIsValid(kMaxPosition, -kMaxPosition));
  EXPECT_FALSE(positionIsValid(kMaxPosition + 1, 0));
  EXPECT_FALSE(positionIsValid(0, INT64_MIN));
  for (int level = 0; level <= kMaxLevel; ++level) {
    const std::int64_t limit = kMaxPosition >> (kFinestSideBits + level);
    EXPECT_TRUE(addressIsValid({level, limit, -limit}));
    EXPECT_FALSE(addressIsValid({level, limit + 1, 0}));
    EXPECT_FALSE(addressIsValid({level, 0, -limit - 1}));
    EXPECT_TRUE(addressIsValid(leafAt({kMaxPosition, -kMaxPosition}, level)));
  }
  EXPECT_FALSE(addressIsValid({-1, 0, 0}));
  EXPECT_FALSE(addressIsValid({kMaxLevel + 1, 0, 0}));
  EXPECT_FALSE(addressIsValid({0, INT64_MAX, INT64_MIN}));
}

TEST(Lattice, CellAndFractionGiveBackThePosition) {
  Random random(6);
  for (int k = 0; k < 10'000; ++k) {
    const Step v = between(random, -kMaxPosition, kMaxPosition);
    const float fraction = fractionOf(v);
    EXPECT_TRUE(fraction >= 0 && fraction < 1);
    EXPECT_EQ((static_cast<Step>(cellOf(v)) << kCellBits) + static_cast<Step>(std::ldexp(static_cast<double>(fraction), kCellBits)), v);
  }
}

TEST(Lattice, MixIsSplitMix64) {
  // First outputs of SplitMix64 from state 0: the mix of successive multiples of its increment.
  const std::uint64_t increment = 0x9e3779b97f4a7c15ull;
  EXPECT_EQ(mix(0), 0xe220a8397b1dcdafull);
  EXPECT_EQ(mix(increment), 0x6e789e6aa1b965f4ull);
  EXPECT_EQ(mix(2 * increment), 0x06c45d188009454full);
}

}  // namespace
}  // namespace ridgecast::lattice
