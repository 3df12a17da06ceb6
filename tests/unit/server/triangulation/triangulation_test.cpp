// Laws of the Delaunay library against a brute-force oracle and against itself in any order.
#include "server/triangulation/triangulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <random>
#include <set>
#include <thread>

#include "tests/support/verify.h"

namespace ridgecast::triangulation {
namespace {

using testing_support::verify;

using Wide = __int128;

// A board of squares, some of them regions.
class Board : public Partition {
 public:
  Board(int bits, int count, std::int32_t corner) : bits_(bits), count_(count), corner_(corner), regions_(count * count, kOutside) {}
  RegionId regionAt(Point2 p) const override {
    const std::int64_t i = (std::int64_t{p.x} - corner_) >> bits_, j = (std::int64_t{p.z} - corner_) >> bits_;
    return i < 0 || j < 0 || i >= count_ || j >= count_ ? kOutside : regions_[i * count_ + j];
  }
  RegionId& at(int i, int j) { return regions_[i * count_ + j]; }
  Square square(int i, int j) const { return {corner_ + i * (1 << bits_), corner_ + j * (1 << bits_), 1 << bits_}; }
  int count() const { return count_; }

 private:
  int bits_, count_;
  std::int32_t corner_;
  std::vector<RegionId> regions_;
};

using Corners = std::array<std::pair<std::int32_t, std::int32_t>, 3>;

Corners sortedCorners(Point2 a, Point2 b, Point2 c) {
  Corners r{{{a.x, a.z}, {b.x, b.z}, {c.x, c.z}}};
  std::sort(r.begin(), r.end());
  return r;
}

std::set<Corners> trianglesOf(const Triangulation& mesh) {
  std::set<Corners> out;
  for (RegionId r = 0; r < mesh.regionLimit(); ++r)
    if (mesh.trianglePages().hasRegion(r))
      mesh.trianglePages().forEach(r, [&](TriangleId t) {
        if (mesh.isGhost(t)) return;
        const auto& v = mesh.triangle(t).v;
        out.insert(sortedCorners(mesh.vertex(v[0]).point(), mesh.vertex(v[1]).point(), mesh.vertex(v[2]).point()));
      });
  return out;
}

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

enum Kind { kRandom, kTinyGrid, kRing, kLines, kHuge, kNearlyCollinear, kDenseAndEmpty, kKinds };

std::vector<Point2> makePoints(Kind kind, int count, std::mt19937& rng) {
  const auto in = [&](int low, int high) { return std::uniform_int_distribution<std::int32_t>(low, high)(rng); };
  std::set<std::pair<std::int32_t, std::int32_t>> set;
  const int tries = count * 20;
  for (int n = 0; n < tries && static_cast<int>(set.size()) < count; ++n) {
    switch (kind) {
      case kRandom:
        set.insert({in(-3000, 3000), in(-3000, 3000)});
        break;
      case kTinyGrid:
        set.insert({in(-3, 4) * 512, in(-3, 4) * 512});
        break;
      case kRing: {
        static const std::pair<int, int> onCircle[] = {{25, 0}, {24, 7}, {20, 15}, {15, 20}, {7, 24}, {0, 25}};
        const auto [p, q] = onCircle[in(0, 5)];
        const int s = in(0, 9) == 0 ? 40 : 80;
        set.insert({(in(0, 1) ? p : -p) * s, (in(0, 1) ? q : -q) * s});
        if (in(0, 6) == 0) set.insert({0, 0});
        break;
      }
      case kLines:
        set.insert(in(0, 4) ? std::pair{in(-40, 40) * 50, 0} : std::pair{in(-40, 40) * 50, in(-2, 2) * 700});
        break;
      case kHuge: {
        const std::int32_t far = (1 << 26) - 1;
        set.insert({in(0, 1) ? in(-far, far) : (in(0, 1) ? far : -far) + 0 * n,
                    in(0, 1) ? in(-far, far) : (in(0, 1) ? far - in(0, 3) : in(0, 3) - far)});
        break;
      }
      case kNearlyCollinear: {
        const std::int32_t x = in(-3000, 3000);
        set.insert({x, x / 3 + in(0, 1)});
        break;
      }
      case kDenseAndEmpty:
        set.insert(in(0, 3) ? std::pair{in(0, 12), in(0, 12)} : std::pair{in(-4000, 4000), in(-4000, 4000)});
        break;
      default:
        break;
    }
  }
  std::vector<Point2> out;
  for (auto [x, z] : set) out.push_back({x, z});
  std::shuffle(out.begin(), out.end(), rng);
  return out;
}

struct World {
  explicit World(Board& b, std::uint32_t room = 20000) : board(b), mesh(room, b) {
    for (int i = 0; i < board.count(); ++i)
      for (int j = 0; j < board.count(); ++j)
        if ((i + 2 * j) % 5 != 0) board.at(i, j) = mesh.addRegion(board.square(i, j));
    all.allowAll();
  }
  Change insert(Point2 p) { return mesh.insert({p.x, p.z, p.x ^ p.z, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all); }
  // Starts from the first three points that are not collinear; false when there are none.
  bool begin(std::vector<Point2> points) {
    for (std::size_t k = 2; k < points.size(); ++k)
      if (orientation(points[0], points[1], points[k]) != 0) {
        const auto v = [&](Point2 p) { return Vertex{p.x, p.z, p.x ^ p.z, kNoEdge}; };
        mesh.start(v(points[0]), v(points[1]), v(points[k]));
        return true;
      }
    return false;
  }
  VertexId find(Point2 p) {
    for (RegionId r = 0; r < mesh.regionLimit(); ++r) {
      VertexId found = kInfinite;
      if (mesh.vertexPages().hasRegion(r))
        mesh.vertexPages().forEach(r, [&](VertexId v) {
          if (v != kInfinite && mesh.vertex(v).point() == p) found = v;
        });
      if (found != kInfinite) return found;
    }
    return kInfinite;
  }
  Board& board;
  Triangulation mesh;
  WriteSet all;
};

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

TEST(Triangulation, RefileFollowsThePartitionAndKeepsTheMesh) {
  std::mt19937 rng(11);
  Board board(10, 8, -4096);
  World world(board);
  const auto points = makePoints(kRandom, 500, rng);
  ASSERT_TRUE(world.begin(points));
  for (Point2 p : points) world.insert(p);
  const auto before = trianglesOf(world.mesh);
  for (int round = 0; round < 40; ++round) {
    const int i = static_cast<int>(rng() % 8), j = static_cast<int>(rng() % 8);
    const RegionId old = board.at(i, j);
    if (old == kOutside) {
      board.at(i, j) = world.mesh.addRegion(board.square(i, j));
      world.mesh.refile(kOutside);
    } else {
      board.at(i, j) = kOutside;
      world.mesh.refile(old);
      world.mesh.removeRegion(old);
    }
    ASSERT_EQ(verify(world.mesh, board), "") << "round " << round;
  }
  EXPECT_EQ(trianglesOf(world.mesh), before);
}

// A merge of leaves: four regions become one without a record that moves.
TEST(Triangulation, AdoptingARegionsPagesMovesNothing) {
  struct Quarters : Partition {
    RegionId parts[4] = {}, whole = kOutside;
    RegionId regionAt(Point2 p) const override {
      if (p.x < -4096 || p.z < -4096 || p.x >= 4096 || p.z >= 4096) return kOutside;
      return whole != kOutside ? whole : parts[(p.x >= 0) + 2 * (p.z >= 0)];
    }
  } quarters;
  Triangulation mesh(20'000, quarters);
  for (int k = 0; k < 4; ++k) quarters.parts[k] = mesh.addRegion({k % 2 * 4096 - 4096, k / 2 * 4096 - 4096, 4096});
  WriteSet all;
  all.allowAll();
  mesh.start({-5000, -5000, 0, kNoEdge}, {-5000, 5000, 0, kNoEdge}, {6000, 0, 0, kNoEdge});
  std::mt19937 rng(3);
  const auto insert = [&](int count) {
    for (int n = 0; n < count; ++n) {
      const Point2 p{static_cast<std::int32_t>(rng() % 8192) - 4096, static_cast<std::int32_t>(rng() % 8192) - 4096};
      mesh.insert({p.x, p.z, 0, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all);
    }
  };
  insert(3000);
  const auto before = trianglesOf(mesh);
  std::uint32_t triangles = 0, vertices = 0;
  quarters.whole = mesh.addRegion({-4096, -4096, 8192});
  for (RegionId part : quarters.parts) {
    triangles += mesh.triangleCount(part);
    vertices += mesh.vertexCount(part);
    mesh.adopt(part, quarters.whole);
    mesh.removeRegion(part);
  }
  mesh.refile(kOutside);
  EXPECT_GE(mesh.triangleCount(quarters.whole), triangles);
  EXPECT_EQ(mesh.vertexCount(quarters.whole), vertices);
  EXPECT_EQ(trianglesOf(mesh), before);
  ASSERT_EQ(verify(mesh, quarters), "");
  insert(1000);
  mesh.compact(quarters.whole);
  ASSERT_EQ(verify(mesh, quarters), "");
}

// Sixteen squares in a larger one; each is one region or four.
struct Checkers : Partition {
  struct Cell {
    RegionId whole = kOutside, parts[4] = {};
  } cells[16];
  static int cellOf(Point2 p) { return (p.x >> 11) + 2 + 4 * ((p.z >> 11) + 2); }
  RegionId regionAt(Point2 p) const override {
    if (p.x < -4096 || p.z < -4096 || p.x >= 4096 || p.z >= 4096) return kOutside;
    const Cell& cell = cells[cellOf(p)];
    return cell.whole != kOutside ? cell.whole : cell.parts[((p.x >> 10) & 1) + 2 * ((p.z >> 10) & 1)];
  }
};

// Splits of leaves, neighbours among them, by one thread and by one for each: nothing but the filing changes, and it changes alike.
TEST(Triangulation, SplitsManyRegionsAtOnce) {
  std::vector<std::vector<std::vector<Point2>>> filed[2];
  for (const bool parallel : {false, true}) {
    Checkers checkers;
    Triangulation mesh(20'000, checkers);
    for (int k = 0; k < 16; ++k) checkers.cells[k].whole = mesh.addRegion({(k % 4 - 2) * 2048, (k / 4 - 2) * 2048, 2048});
    WriteSet all;
    all.allowAll();
    mesh.start({-5000, -5000, 0, kNoEdge}, {-5000, 5000, 0, kNoEdge}, {6000, 0, 0, kNoEdge});
    std::mt19937 rng(5);
    for (int n = 0; n < 6000; ++n) {
      const Point2 p{static_cast<std::int32_t>(rng() % 9000) - 4500, static_cast<std::int32_t>(rng() % 9000) - 4500};
      mesh.insert({p.x, p.z, 0, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all);
    }
    const auto before = trianglesOf(mesh);
    for (RegionId r = 0; r < mesh.regionLimit(); ++r)
      mesh.trianglePages().forEach(r, [&](TriangleId t) {
        if (t % 3 != 0) mesh.trianglePages().clearFresh(t);
      });
    const auto freshOnes = [&] {
      std::uint32_t count = 0;
      for (RegionId r = 0; r < mesh.regionLimit(); ++r)
        if (mesh.trianglePages().hasRegion(r)) mesh.trianglePages().forEachFresh(r, [&](TriangleId) { ++count; });
      return count;
    };
    const std::uint32_t fresh = freshOnes();
    std::vector<RegionId> splits;
    std::atomic<std::uint32_t> told{0};
    std::uint32_t triangles = 0;
    for (int k : {0, 1, 4, 5, 6, 10, 15}) {  // a block, a diagonal, a corner
      auto& cell = checkers.cells[k];
      splits.push_back(cell.whole);
      triangles += mesh.triangleCount(cell.whole);
      for (int q = 0; q < 4; ++q)
        cell.parts[q] = mesh.addRegion({(k % 4 - 2) * 2048 + q % 2 * 1024, (k / 4 - 2) * 2048 + q / 2 * 1024, 1024});
      cell.whole = kOutside;
    }
    const auto loop = [&](std::size_t count, const std::function<void(std::size_t)>& body) {
      std::vector<std::thread> threads;
      for (std::size_t k = 0; k < count; ++k)
        if (parallel)
          threads.emplace_back(body, k);
        else
          body(k);
      for (auto& thread : threads) thread.join();
    };
    ASSERT_TRUE(mesh.split(splits, loop, {[&](std::span<const Move> moves) { told += static_cast<std::uint32_t>(moves.size()); }, {}}));
    for (RegionId region : splits) {
      EXPECT_EQ(mesh.triangleCount(region) + mesh.vertexCount(region), 0u);
      mesh.removeRegion(region);
    }
    EXPECT_GT(triangles, 1000u);
    EXPECT_EQ(told, triangles);
    EXPECT_EQ(freshOnes(), fresh);
    EXPECT_EQ(trianglesOf(mesh), before);
    ASSERT_EQ(verify(mesh, checkers), "");
    for (const auto& cell : checkers.cells)
      for (RegionId part : cell.parts) {
        auto& list = filed[parallel].emplace_back();
        if (cell.whole == kOutside)
          mesh.trianglePages().forEach(part, [&](TriangleId t) {
            auto& corners = list.emplace_back();
            for (VertexId v : mesh.triangle(t).v) corners.push_back(mesh.vertex(v).point());
          });
      }
    // And it goes on living.
    for (int n = 0; n < 1000; ++n) {
      const Point2 p{static_cast<std::int32_t>(rng() % 8192) - 4096, static_cast<std::int32_t>(rng() % 8192) - 4096};
      mesh.insert({p.x, p.z, 0, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all);
    }
    ASSERT_EQ(verify(mesh, checkers), "");
  }
  EXPECT_EQ(filed[0], filed[1]);
}

// Everything is held twice for a while: where that may be too much, nothing is done.
TEST(Triangulation, RefusesASplitThatStorageMayNotHold) {
  Checkers checkers;
  Triangulation mesh(64, checkers);
  for (int k = 0; k < 16; ++k) checkers.cells[k].whole = mesh.addRegion({(k % 4 - 2) * 2048, (k / 4 - 2) * 2048, 2048});
  while (mesh.trianglePages().hasFree(mesh.regionLimit() + 4)) mesh.trianglePages().allocate(kOutside);
  const RegionId split = checkers.cells[3].whole;
  for (int k = 0; k < 4 * 64; ++k) mesh.trianglePages().allocate(split);
  EXPECT_FALSE(mesh.split({&split, 1}, [](std::size_t, const std::function<void(std::size_t)>&) { FAIL(); }));
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

// Threads with disjoint write sets give the mesh that one thread gives.
TEST(Triangulation, ThreadsWithDisjointSetsGiveTheSameMesh) {
  std::mt19937 rng(21);
  const auto build = [&](bool threads) {
    Board board(13, 8, -32768);
    Triangulation mesh(100000, board);
    for (int i = 0; i < 8; ++i)
      for (int j = 0; j < 8; ++j) board.at(i, j) = mesh.addRegion(board.square(i, j));
    WriteSet all;
    all.allowAll();
    mesh.start({-32768, -32768, 0, kNoEdge}, {32767, -32768, 0, kNoEdge}, {-32768, 32767, 0, kNoEdge});
    for (int i = 0; i <= 32; ++i)
      for (int j = 0; j <= 32; ++j) {
        const Point2 p{std::min(-32768 + i * 2048, 32767), std::min(-32768 + j * 2048, 32767)};
        mesh.insert({p.x, p.z, 0, kNoEdge}, mesh.locate(p, mesh.anyTriangle(), all), all);
      }
    const auto work = [&](int ci, int cj) {
      std::vector<RegionId> regions;
      for (int i = ci - 1; i <= ci + 1; ++i)
        for (int j = cj - 1; j <= cj + 1; ++j) regions.push_back(board.at(i, j));
      WriteSet set;
      set.allow(regions);
      std::mt19937 own(static_cast<unsigned>(ci * 8 + cj));
      TriangleId hint = kNoEdge;
      mesh.trianglePages().forEach(board.at(ci, cj), [&](TriangleId t) { hint = t; });
      std::vector<VertexId> made;
      for (int n = 0; n < 2000; ++n) {
        const Point2 p{static_cast<std::int32_t>(-32768 + ci * 8192 + static_cast<int>(own() % 8192)),
                       static_cast<std::int32_t>(-32768 + cj * 8192 + static_cast<int>(own() % 8192))};
        const TriangleId t = mesh.locate(p, hint, set);
        VertexId v;
        if (t != kNoEdge && mesh.insert({p.x, p.z, 0, kNoEdge}, t, set, &v) == Change::kDone) {
          made.push_back(v);
          hint = mesh.edgeOf(v) >> 2;
        }
        if (n % 3 == 2 && made.size() > 10) {
          const VertexId gone = made[made.size() - 5];
          const HalfEdge h = mesh.edgeOf(gone);
          const HalfEdge outer = mesh.twin(Triangulation::next(h));
          if (mesh.remove(gone, set) == Change::kDone) {
            made.erase(made.end() - 5);
            hint = outer >> 2;
          }
        }
      }
    };
    if (threads) {
      std::thread a(work, 1, 1), b(work, 4, 1), c(work, 1, 5), d(work, 5, 5);
      a.join(), b.join(), c.join(), d.join();
    } else {
      work(5, 5), work(1, 5), work(4, 1), work(1, 1);
    }
    EXPECT_EQ(verify(mesh, board), "");
    return trianglesOf(mesh);
  };
  EXPECT_EQ(build(true), build(false));
}

}  // namespace
}  // namespace ridgecast::triangulation
