// Laws of the Delaunay library against a brute-force oracle and against itself in any order.
#include "common/triangulation/triangulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "board.h"
#include "tests/support/verify.h"

namespace ridgecast::triangulation {
namespace {

using testing_support::verify;

using Wide = __int128;

// The oracle: a triple is a triangle when no other point is in its circle; of cocircular points, the smallest one's diagonals stay.
Wide cross(Point2 a, Point2 b, Point2 c) { return (Wide{b.x} - a.x) * (Wide{a.z} - c.z) - (Wide{a.z} - b.z) * (Wide{c.x} - a.x); }
std::set<Corners> oracle(const std::vector<Point2>& points) {
  std::set<Corners> out;
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = i + 1; j < points.size(); ++j)
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        Point2 a = points[i], b = points[j], c = points[k];
        const Wide turn = cross(a, b, c);
        if (turn == 0) continue;
        if (turn < 0) std::swap(b, c);
        bool empty = true;
        for (const Point2& d : points) {
          if (d == a || d == b || d == c) continue;
          Wide m[3][3];
          const Point2* corner[3] = {&a, &b, &c};
          for (int r = 0; r < 3; ++r) {
            const Wide x = Wide{corner[r]->x} - d.x, q = Wide{d.z} - corner[r]->z;
            m[r][0] = x;
            m[r][1] = q;
            m[r][2] = x * x + q * q;
          }
          const Wide det = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
          if (det > 0) empty = false;
          if (det == 0) {
            std::array<Point2, 4> four{a, b, c, d};
            std::sort(four.begin(), four.end(), [](Point2 u, Point2 v) { return smaller(u, v); });
            const Point2 least = four[0];
            if (least == d) {
              empty = false;
            } else {  // the triple holds the smallest: wrong when d is its opposite, that is, when least-d separates the other two
              std::vector<Point2> others;
              for (Point2 p : {a, b, c})
                if (!(p == least)) others.push_back(p);
              if ((cross(least, d, others[0]) > 0) != (cross(least, d, others[1]) > 0)) empty = false;
            }
          }
          if (!empty) break;
        }
        if (empty) out.insert(sortedCorners(a, b, c));
      }
  return out;
}

class Sets : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Kinds, Sets, testing::Range(0, static_cast<int>(kKinds)));

TEST_P(Sets, EqualTheOracleInAnyOrderWithInsertionsAndRemovals) {
  for (unsigned seed = 0; seed < 25; ++seed) {
    std::mt19937 rng(seed * 100 + static_cast<unsigned>(GetParam()));
    const auto points = makePoints(static_cast<Kind>(GetParam()), 8 + static_cast<int>(rng() % 24), rng);
    Board board(10, 8, -4096);
    World world(board);
    if (!world.begin(points)) continue;
    std::vector<Point2> held;
    for (Point2 p : points) {
      const Change change = world.insert(p);
      ASSERT_TRUE(change == Change::kDone || change == Change::kDuplicate);
      held.push_back(p);
      ASSERT_EQ(verify(world.mesh, board), "") << "seed " << seed;
    }
    ASSERT_EQ(trianglesOf(world.mesh), oracle(held)) << "seed " << seed;
    std::shuffle(held.begin(), held.end(), rng);
    while (held.size() > 3) {
      const Point2 p = held.back();
      held.pop_back();
      const Change change = world.mesh.remove(world.find(p), world.all);
      const auto expected = oracle(held);
      if (change == Change::kRefused) {
        ASSERT_TRUE(expected.empty()) << "seed " << seed;
        break;
      }
      ASSERT_EQ(change, Change::kDone);
      ASSERT_EQ(verify(world.mesh, board), "") << "seed " << seed << ", " << held.size() << " left";
      ASSERT_EQ(trianglesOf(world.mesh), expected) << "seed " << seed << ", " << held.size() << " left";
    }
  }
}

TEST(Triangulation, InsertThenRemoveIsNothing) {
  std::mt19937 rng(7);
  Board board(12, 8, -16384);
  World world(board, 20000);
  auto points = makePoints(kRandom, 900, rng);
  ASSERT_TRUE(world.begin(points));
  for (int k = 0; k < 600; ++k) world.insert(points[k]);
  const auto before = trianglesOf(world.mesh);
  for (int k = 600; k < 900; ++k) ASSERT_EQ(world.insert(points[k]), Change::kDone);
  std::vector<int> order(300);
  for (int k = 0; k < 300; ++k) order[k] = 600 + k;
  std::shuffle(order.begin(), order.end(), rng);
  for (int k : order) ASSERT_EQ(world.mesh.remove(world.find(points[k]), world.all), Change::kDone);
  EXPECT_EQ(verify(world.mesh, board), "");
  EXPECT_EQ(trianglesOf(world.mesh), before);
}

TEST(Triangulation, RefusesADuplicate) {
  Board board(10, 8, -4096);
  World world(board);
  world.mesh.start({0, 0, 0, kNoEdge}, {1000, 0, 0, kNoEdge}, {0, 1000, 0, kNoEdge});
  EXPECT_EQ(world.insert({0, 0}), Change::kDuplicate);
  EXPECT_EQ(world.insert({10, 10}), Change::kDone);
  EXPECT_EQ(world.insert({10, 10}), Change::kDuplicate);
  EXPECT_EQ(verify(world.mesh, board), "");
}

TEST(Triangulation, ADeferredChangeWritesNothing) {
  std::mt19937 rng(3);
  Board board(10, 8, -4096);
  World world(board);
  const auto points = makePoints(kRandom, 300, rng);
  ASSERT_TRUE(world.begin(points));
  for (int k = 0; k < 200; ++k) world.insert(points[k]);
  int deferred = 0, done = 0;
  for (int k = 200; k < 300; ++k) {
    const TriangleId t = world.mesh.locate(points[k], world.mesh.anyTriangle(), world.all);
    WriteSet own;
    const RegionId home = world.mesh.regionOf(t);
    own.allow(std::span(&home, 1));
    const auto before = trianglesOf(world.mesh);
    if (world.mesh.insert({points[k].x, points[k].z, 0, kNoEdge}, t, own) == Change::kDeferred) {
      ++deferred;
      EXPECT_EQ(trianglesOf(world.mesh), before);
    } else {
      ++done;
    }
    ASSERT_EQ(verify(world.mesh, board), "");
  }
  EXPECT_GT(deferred, 0);
  EXPECT_GT(done, 0);
}

TEST(Triangulation, ReusesTheStorageOfWhatWasRemoved) {
  std::mt19937 rng(5);
  Board board(12, 8, -16384);
  World world(board, 4000);
  const auto points = makePoints(kRandom, 1500, rng);
  ASSERT_TRUE(world.begin(points));
  std::size_t most = 0;
  for (int round = 0; round < 30; ++round) {
    for (std::size_t k = 3; k < points.size(); ++k) ASSERT_NE(world.insert(points[k]), Change::kFull);
    if (round == 0) most = world.mesh.residentBytes();
    for (std::size_t k = points.size() - 1; k > 20; --k) ASSERT_EQ(world.mesh.remove(world.find(points[k]), world.all), Change::kDone);
  }
  for (std::size_t k = 3; k < points.size(); ++k) world.insert(points[k]);
  EXPECT_LE(world.mesh.residentBytes(), most * 5 / 4);
  EXPECT_EQ(verify(world.mesh, board), "");
}

TEST(Triangulation, CompactingKeepsTheMesh) {
  std::mt19937 rng(8);
  Board board(12, 8, -16384);
  World world(board, 20000);
  const auto points = makePoints(kRandom, 3000, rng);
  ASSERT_TRUE(world.begin(points));
  for (Point2 p : points) world.insert(p);
  for (std::size_t k = 3; k < points.size(); ++k)
    if (k % 8 != 0) {
      ASSERT_EQ(world.mesh.remove(world.find(points[k]), world.all), Change::kDone);
    }
  const auto before = trianglesOf(world.mesh);
  const std::size_t bytes = world.mesh.residentBytes();
  std::size_t moved = 0;
  for (RegionId r = 0; r < world.mesh.regionLimit(); ++r)
    if (world.mesh.trianglePages().hasRegion(r)) world.mesh.compact(r, {[&](std::span<const Move> moves) { moved += moves.size(); }, {}});
  EXPECT_GT(moved, 0u);
  EXPECT_LT(world.mesh.residentBytes(), bytes / 2);
  EXPECT_EQ(trianglesOf(world.mesh), before);
  EXPECT_EQ(verify(world.mesh, board), "");
  for (std::size_t k = 3; k < points.size(); ++k)
    if (k % 8 != 0) {
      ASSERT_EQ(world.insert(points[k]), Change::kDone);
    }
  EXPECT_EQ(verify(world.mesh, board), "");
}

// Pages that were empty when their region lost its last record once stayed lost with it.
TEST(Pages, EveryPageComesBack) {
  std::mt19937 rng(4);
  TrianglePages pages(64 * 200);
  for (int round = 0; round < 300; ++round) {
    std::vector<RegionId> regions;
    std::vector<std::uint32_t> slots;
    for (int r = 0; r < 8; ++r) {
      regions.push_back(pages.addRegion());
      for (unsigned n = rng() % 400; n > 0; --n) slots.push_back(pages.allocate(regions.back()));
    }
    std::shuffle(slots.begin(), slots.end(), rng);
    for (std::uint32_t slot : slots) pages.release(slot);
    for (RegionId r : regions) pages.removeRegion(r);
    ASSERT_EQ(pages.pagesInUse(), 0u) << "round " << round;
    ASSERT_EQ(pages.blocksInUse(), 0u) << "round " << round;
  }
}

TEST(Predicates, ObeyTheirLaws) {
  std::mt19937 rng(1);
  const std::int32_t far = (1 << 26) - 1;
  int convex = 0;
  for (int n = 0; n < 200000; ++n) {
    const std::int32_t range = n % 3 == 0 ? 6 : n % 3 == 1 ? 5000 : far;
    const auto in = [&] { return std::uniform_int_distribution<std::int32_t>(-range, range)(rng); };
    const Point2 a{in(), in()}, b{in(), in()}, c{in(), in()}, d{in(), in()};
    const std::int64_t turn = orientation(a, b, c);
    EXPECT_EQ(turn, orientation(b, c, a));
    EXPECT_EQ(turn, -orientation(b, a, c));
    if (turn <= 0 || a == d || b == d || c == d) continue;
    const bool inside = inCircle(a, b, c, d);
    EXPECT_EQ(inside, inCircle(b, c, a, d));
    EXPECT_EQ(inside, inCircle(c, a, b, d));
    // Of the two diagonals of a convex quadrilateral exactly one is Delaunay.
    if (orientation(b, c, d) > 0 && orientation(c, d, a) > 0 && orientation(d, a, b) > 0) {
      EXPECT_NE(inside, inCircle(b, c, d, a));
      ++convex;
    }
  }
  EXPECT_GT(convex, 1000);
}

}  // namespace
}  // namespace ridgecast::triangulation
