// Regions of a mesh that change: filed anew, split, and worked on by several threads.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <random>
#include <thread>
#include <vector>

#include "board.h"
#include "tests/support/verify.h"

namespace ridgecast::triangulation {
namespace {

using testing_support::verify;

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
