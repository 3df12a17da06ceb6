#include "common/triangulation/storage.h"
#include "tests/support/sanitized.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

namespace ridgecast::triangulation {
namespace {

// What is alive and fresh in each region, kept twice: random changes, and after each the same answers.
struct Model {
  struct Region {
    std::set<std::uint32_t> alive, fresh;
    bool changed = false;
  };
  std::map<RegionId, Region> regions{{kOutside, {}}};

  template <class Storage>
  void expectSame(Storage& pages) {
    std::uint32_t live = 0;
    for (auto& [id, region] : regions) {
      std::set<std::uint32_t> alive, fresh, listed;
      pages.forEach(id, [&](std::uint32_t slot) {
        EXPECT_EQ(pages.regionOf(slot), id);
        EXPECT_TRUE(pages.alive(slot));
        EXPECT_EQ(pages.slotAt(pages.pageOf(slot), pages.indexOf(slot)), slot);
        alive.insert(slot);
      });
      pages.forEachFresh(id, [&](std::uint32_t slot) { fresh.insert(slot); });
      EXPECT_EQ(alive, region.alive);
      EXPECT_EQ(fresh, region.fresh);
      EXPECT_EQ(pages.count(id), region.alive.size());
      EXPECT_LE(pages.listLength(id), 2 * pages.pagesOf(id).size() + 8);
      EXPECT_EQ(pages.changed(id), region.changed);
      live += pages.count(id);
    }
    EXPECT_EQ(pages.live(), live);
  }
};

template <class Storage>
void answersAsAModelDoes() {
  std::mt19937 rng(4);
  for (int round = 0; round < testing_support::rounds(20); ++round) {
    Storage pages(6000);
    Model model;
    for (int k = 0; k < 4; ++k) model.regions[pages.addRegion()] = {};
    const auto anyRegion = [&] {
      return std::next(model.regions.begin(), static_cast<std::ptrdiff_t>(rng() % model.regions.size()))->first;
    };
    const auto move = [&](Model::Region& from, Model::Region& to, Move m) {
      to.alive.insert(m.to);
      if (from.fresh.count(m.from)) to.fresh.insert(m.to);
    };
    for (int step = 0; step < 300; ++step) {
      const RegionId id = anyRegion();
      Model::Region& region = model.regions[id];
      const auto anySlot = [&] { return *std::next(region.alive.begin(), static_cast<std::ptrdiff_t>(rng() % region.alive.size())); };
      switch (rng() % 9) {
        case 0:
        case 1:
          for (unsigned n = rng() % 100; n > 0; --n) {
            const std::uint32_t slot = pages.allocate(id);
            ASSERT_NE(slot, kNoSlot);
            ASSERT_TRUE(region.alive.insert(slot).second);
            region.fresh.insert(slot);
            region.changed = true;
          }
          break;
        case 2:
          for (unsigned n = rng() % 100; n > 0 && !region.alive.empty(); --n) {
            const std::uint32_t slot = anySlot();
            pages.release(slot);
            EXPECT_FALSE(pages.alive(slot));
            region.alive.erase(slot);
            region.fresh.erase(slot);
            region.changed = true;
          }
          break;
        case 3:
          for (unsigned n = rng() % 20; n > 0 && !region.alive.empty(); --n) {
            const std::uint32_t slot = anySlot();
            pages.renew(slot);
            region.fresh.insert(slot);
          }
          break;
        case 4: {  // evaluation: every page with fresh slots is told of, once
          std::set<std::uint32_t> told, slots;
          pages.takeFresh(id, [&](std::uint32_t page, TrianglePages::Mask fresh) {
            EXPECT_TRUE(fresh != 0 && told.insert(page).second);
            pages.forEachIn(page, fresh, [&](std::uint32_t slot) { slots.insert(slot); });
          });
          EXPECT_EQ(slots, region.fresh);
          region.fresh.clear();
          pages.clearChanged(id);
          region.changed = false;
          break;
        }
        case 5: {  // all of one region moves to a new one, as splits do
          const RegionId heir = pages.addRegion();
          Model::Region& now = model.regions[heir];
          std::vector<Move> moves;
          for (std::uint32_t slot : region.alive) moves.push_back({slot, kNoSlot});
          pages.receive(heir, moves, [&](std::uint32_t from, std::uint32_t to) { move(region, now, {from, to}); });
          now.changed = !moves.empty();
          for (const Move& m : moves) EXPECT_TRUE(now.alive.count(m.to));
          pages.drain(id);
          region = {{}, {}, true};
          break;
        }
        case 6: {  // adoption moves nothing
          const RegionId heir = anyRegion();
          if (heir == id) break;
          Model::Region& now = model.regions[heir];
          pages.adopt(id, heir);
          now.alive.merge(region.alive);
          now.fresh.merge(region.fresh);
          now.changed = true;
          region.alive.clear();
          region.fresh.clear();
          break;
        }
        case 7:
          if (pages.sparse(id)) {
            Model::Region now = region;
            pages.compact(id, [&](std::uint32_t from, std::uint32_t to) {
              now.alive.erase(from);
              now.alive.insert(to);
              if (now.fresh.erase(from)) now.fresh.insert(to);
              now.changed = true;
            });
            region = now;
            EXPECT_FALSE(pages.sparse(id));
          }
          break;
        default:
          if (id != kOutside && region.alive.empty() && model.regions.size() > 3) {
            pages.removeRegion(id);
            model.regions.erase(id);
          }
      }
      model.expectSame(pages);
      if (testing::Test::HasFailure()) FAIL() << "round " << round << ", step " << step;
    }
  }
}

// Nobody asks for the fresh pages of what lies outside all leaves, nor of vertices: what is remembered for who might ask stays small.
TEST(Pages, RememberLittleOfPagesThatCameAndWent) {
  TrianglePages pages(64 * 100);
  for (int round = 0; round < 1000; ++round) {
    std::vector<std::uint32_t> slots;
    for (int k = 0; k < 640; ++k) slots.push_back(pages.allocate(kOutside));
    for (std::size_t k = 10; k < slots.size(); ++k) pages.release(slots[k]);
    ASSERT_LE(pages.listLength(kOutside), 2 * 110u + 8) << "round " << round;
    if (round % 100 == 99) {
      std::size_t told = 0, expected = 0;
      for (std::uint32_t page : pages.pagesOf(kOutside)) expected += pages.freshMask(page) != 0;
      pages.takeFresh(kOutside, [&](std::uint32_t, TrianglePages::Mask) { ++told; });
      EXPECT_EQ(told, expected);
      pages.drain(kOutside);
    }
  }
}

// A camera holds 1,600 regions, most of them with 8 triangles: each once took a page of 64.
TEST(Pages, SmallRegionsTakeABlockEach) {
  TrianglePages pages(64 * 1000);
  std::vector<RegionId> regions;
  for (int r = 0; r < 1000; ++r) {
    regions.push_back(pages.addRegion());
    for (int n = 0; n < 8; ++n) pages.allocate(regions.back());
  }
  EXPECT_EQ(pages.blocksInUse(), 1000u);
  for (RegionId r : regions) pages.drain(r);
  EXPECT_EQ(pages.blocksInUse(), 0u);
}

TEST(Pages, OfTrianglesAnswerAsAModelDoes) { answersAsAModelDoes<TrianglePages>(); }
TEST(Pages, OfVerticesAnswerAsAModelDoes) { answersAsAModelDoes<VertexPages>(); }

}  // namespace
}  // namespace ridgecast::triangulation
