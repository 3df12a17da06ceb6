// Undos against a history that makes everything again, from the first edit on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <memory>
#include <random>
#include <set>

#include "common/edits/area_index.h"
#include "common/edits/history.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::edits {
namespace {

using lattice::Step;
using testing_support::m;
using testing_support::randomOperation;

// Operations in pages, as a log gives them.
History::Read pagesOf(const std::vector<Operation>& operations, std::size_t page, int* reads = nullptr) {
  return [=](std::uint64_t after) -> Outcome<History::Past> {
    if (reads) ++*reads;
    History::Past out{after == 0 ? std::make_shared<const Layer>() : nullptr, {}};
    for (std::size_t k = after; k < std::min<std::size_t>(operations.size(), after + page); ++k) out.operations.push_back(operations[k]);
    return out;
  };
}

std::vector<Operation> operationsOf(const History& history) {
  std::vector<Operation> out;
  for (std::uint64_t n = 1; n <= history.last(); ++n) out.push_back(history.operation(n));
  return out;
}

void expectSameGround(const Layer& a, const Layer& b) {
  EXPECT_EQ(a.hash(), b.hash());
  for (const Layer* layer : {&a, &b})
    for (const TileAddress t : layer->addresses()) {
      const Tile *const one = a.tile(t), *const other = b.tile(t);
      ASSERT_TRUE((one ? one->posts() : TilePosts()) == (other ? other->posts() : TilePosts())) << t.i << " " << t.j;
    }
}

void expectReplayed(const std::shared_ptr<const terrain::Terrain>& terrain, const History& history) {
  History again(terrain);
  again.restore(0, history.last(), nullptr, pagesOf(operationsOf(history), 1000));
  ASSERT_TRUE(again.replay());
  expectSameGround(*again.layer(), *history.layer());
  for (std::uint64_t n = 1; n <= history.last(); ++n) ASSERT_EQ(again.isUndone(n), history.isUndone(n)) << n;
}

Operation small(double x, double z) { return {Crater{{m(x), m(z)}, m(2), static_cast<std::int32_t>(m(0.1))}, 0}; }

std::uint64_t lookedBy(History& history, const Operation& operation) {
  const std::uint64_t before = history.looked();
  EXPECT_TRUE(history.add(operation));
  return history.looked() - before;
}

// Restored on the way, with and without what came before.
TEST(Undo, IsAReplayWithoutTheEdit) {
  const auto terrain = terrain::create("alpine", 1).value();
  for (int seed = 0; seed < testing_support::rounds(6); ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    auto history = std::make_unique<History>(terrain);
    int undone = 0;
    while (history->last() < 150) {
      const bool undoes = history->last() > 0 && random() % 3 == 0;
      // Half of them of late edits.
      const std::uint64_t edit = undoes ? (random() % 2 ? 1 + random() % history->last()
                                                        : history->last() - random() % std::min<std::uint64_t>(history->last(), 9))
                                        : 0;
      const lattice::Point middle = random() % 4 == 0 ? lattice::Point{m(150), 0} : lattice::Point{0, 0};
      const auto before = history->layer();
      const auto added = history->add(undoes ? Operation{Undo{edit}, 0} : randomOperation(random, middle));
      if (!added) continue;  // it was undone
      undone += undoes;
      if (undoes)
        for (const TileAddress t : before->addresses())
          if (!t.posts().meets(*added) && !before->tile(t)->isZero()) {
            ASSERT_EQ(before->tile(t), history->layer()->tile(t)) << "elsewhere";
          }
      if (undoes && undone % 8 == 0) expectReplayed(terrain, *history);
      if (history->last() == 60 || history->last() == 100) {
        auto restored = std::make_unique<History>(terrain);
        restored->restore(0, history->last(), history->layer(), pagesOf(operationsOf(*history), 7));
        history = std::move(restored);
        ASSERT_TRUE(history->add(randomOperation(random, middle)));
        ASSERT_FALSE(history->prepare({Undo{history->last() + 1}, 0}));
        ASSERT_TRUE(history->add({Undo{history->last()}, 0}));
      }
    }
    expectReplayed(terrain, *history);
    EXPECT_GT(undone, 30);
    EXPECT_GT(history->checkpointBytes(), 0u);
  }
}

// In a row along which each reads what its neighbours change, made in its order or in any: some carry a wall on far beyond what they read.
TEST(Undo, FollowsSmoothingsFromOneToTheNext) {
  const auto terrain = terrain::create("alpine", 1).value();
  for (int seed = 0; seed < testing_support::rounds(40); ++seed) {
    std::mt19937_64 random(static_cast<std::uint64_t>(seed));
    const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
    std::vector<Smooth> row;
    for (double x = 0; row.size() < 20; x += uniform(2, seed % 2 ? 20 : 5))
      row.push_back({{m(x), m(uniform(-3, 3))}, m(uniform(4, 8)), static_cast<std::uint32_t>(uniform(8, kMaxPasses + 1))});
    if (seed % 4 >= 2) std::ranges::shuffle(row, random);
    History history(terrain);
    for (const double x : {0.0, 30.0, 60.0}) ASSERT_TRUE(history.add({Raise{{m(x), 0}, m(3), 0, static_cast<std::int32_t>(m(100))}, 0}));
    for (const Smooth& smooth : row) ASSERT_TRUE(history.add({smooth, 0}));
    for (const std::uint64_t edit : {1u, 3u, 2u}) {
      ASSERT_TRUE(history.add({edits::Undo{edit}, 0}));
      expectReplayed(terrain, history);
      ASSERT_FALSE(testing::Test::HasFailure()) << seed << ", without " << edit;
    }
  }
}

// Beyond what the first of them reads: each again and again, until a wall of a kilometre has come through to the far side.
TEST(Undo, FollowsASmoothingThatOnlyAnotherChanged) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  ASSERT_TRUE(history.add({Raise{{m(6), 0}, m(1), 0, static_cast<std::int32_t>(m(1000))}, 0}));
  for (const double x : {15.0, 24.5})  // posts 14 to 46 and 33 to 65; tiles have 16
    for (int k = 0; k < 30; ++k) ASSERT_TRUE(history.add({Smooth{{m(x), 0}, m(8), kMaxPasses}, 0}));
  ASSERT_TRUE(history.add({edits::Undo{1}, 0}));
  expectReplayed(terrain, history);
}

TEST(Undo, MakesAgainWhatASmoothingReadsThroughAnother) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  for (const double x : {4.0, 17.0}) ASSERT_TRUE(history.add({Raise{{m(x), 0}, m(1), 0, static_cast<std::int32_t>(m(1000))}, 0}));
  for (int k = 0; k < 30; ++k) ASSERT_TRUE(history.add({Smooth{{m(13), 0}, m(2.5), 3}, 0}));  // posts 21 to 31
  ASSERT_TRUE(history.add({Smooth{{m(5), 0}, m(2.5), kMaxPasses}, 0}));                       // 5 to 15
  ASSERT_TRUE(history.add({edits::Undo{1}, 0}));
  expectReplayed(terrain, history);
}

TEST(Undo, OfALateEditMakesFewAgain) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  std::uint64_t all = 0;
  for (int k = 0; k < 20'000; ++k) all += lookedBy(history, small(k % 7, k % 5));
  EXPECT_GT(all, 3'000'000u);
  EXPECT_LT(lookedBy(history, {Undo{19'990}, 0}), 300'000u);
  EXPECT_LT(lookedBy(history, {Undo{19'980}, 0}), 300'000u) << "what was undone is out of the checkpoints, too";
  EXPECT_LT(lookedBy(history, {Undo{20'001}, 0}), 300'000u);
  // As much again as was done since, and once more.
  EXPECT_LT(lookedBy(history, {Undo{15'000}, 0}), all / 2 + 300'000);
  expectReplayed(terrain, history);
}

TEST(Undo, BeneathTenThousandElsewhereCostsWhatTheEditDoes) {
  History history(terrain::create("alpine", 1).value());
  const std::uint64_t own = lookedBy(history, small(0, 0));
  for (int row = 0; row < 100; ++row)
    for (int column = 0; column < 100; ++column) ASSERT_TRUE(history.add(small(20 + column * 5, row * 5)));
  EXPECT_EQ(lookedBy(history, {Undo{1}, 0}), 0u);
  EXPECT_EQ(lookedBy(history, {Undo{10'002}, 0}), own);
  // What it costs to find that out is counted, too.
  History::Making making = history.make({Undo{1}, 0}, 3000);
  while (!making.step(100)) {
  }
  EXPECT_TRUE(making.result()) << making.result().error().message;
}

TEST(Undo, OfTooMuchIsRefusedBeforeItBegins) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  for (int k = 0; k < 300; ++k) ASSERT_TRUE(history.add(small(k % 3, 0)));
  const std::uint64_t looked = history.looked();
  const auto layer = history.layer();
  const auto made = [&](std::uint64_t edit, std::uint64_t most) {
    History::Making making = history.make({Undo{edit}, 0}, most);
    while (!making.step(1000)) {
    }
    return making.result();
  };
  EXPECT_EQ(
      made(1, 20'000).error().message,
      "To undo edit 1, too many others would have to be made again; undo later ones there first, or change the ground by another edit.");
  EXPECT_EQ(history.looked(), looked);
  EXPECT_EQ(history.layer(), layer);
  EXPECT_EQ(history.last(), 300u);
  EXPECT_FALSE(history.isUndone(1));
  EXPECT_TRUE(made(300, 20'000'000));
  EXPECT_TRUE(made(1, 20'000'000));
  expectReplayed(terrain, history);
}

// An undo of an undo of an undo ... is a walk down to the first.
TEST(Undo, OfALongChainCountsAsWork) {
  History history(terrain::create("alpine", 1).value());
  ASSERT_TRUE(history.add(small(0, 0)));
  for (std::uint64_t n = 1; n <= 2000; ++n) ASSERT_TRUE(history.add({Undo{n}, 0}));
  EXPECT_FALSE(history.isUndone(1));
  History::Making making = history.make({Undo{2001}, 0}, 10'000);
  while (!making.step(1000)) {
  }
  EXPECT_THAT(making.result().error().message, testing::HasSubstr("To undo edit 2001, too many"));
  EXPECT_TRUE(history.add({Undo{2001}, 0}));
  EXPECT_TRUE(history.isUndone(1));
}

TEST(Making, InTurnsIsTheSameAndGivenUpIsNothing) {
  const auto terrain = terrain::create("alpine", 1).value();
  std::mt19937_64 random(3);
  History whole(terrain), turned(terrain);
  int steps = 0, undos = 0;
  while (whole.last() < 80) {
    const bool undoes = whole.last() > 5 && random() % 3 == 0;
    const Operation operation = undoes ? Operation{Undo{1 + random() % whole.last()}, 0} : randomOperation(random, {0, 0});
    const auto wanted = whole.add(operation);
    undos += undoes && wanted;
    // Given up after so many turns, at last after all but one.
    for (std::uint64_t most = 1;; most *= 2) {
      const std::uint64_t last = turned.last();
      const auto layer = turned.layer();
      History::Making making = turned.make(operation);
      bool isDone = false;
      for (std::uint64_t n = 0; n < most && !isDone; ++n, ++steps) {
        ASSERT_EQ(turned.layer(), layer) << "nothing is seen before it is done";
        ASSERT_EQ(turned.last(), last);
        isDone = making.step(1500);
      }
      if (!isDone) continue;
      ASSERT_EQ(making.result().has_value(), wanted.has_value());
      if (wanted) {
        EXPECT_EQ(*making.result(), *wanted);
      }
      break;
    }
    ASSERT_EQ(turned.last(), whole.last());
    expectSameGround(*whole.layer(), *turned.layer());
    for (std::uint64_t n = 1; n <= whole.last(); ++n) ASSERT_EQ(turned.isUndone(n), whole.isUndone(n));
  }
  EXPECT_GT(undos, 10);
  EXPECT_GT(steps, 1000);
}

// The widest edits, in steps of some milliseconds.
TEST(Making, NoTurnIsLong) {
  History history(terrain::create("alpine", 1).value());
  Road road{{{0, 0, 0}, {m(1400), m(1400), 0}}, false, m(8), 26, 171};
  for (const Operation& o : {Operation{Raise{{0, 0}, m(256), 0, 900}, 1}, Operation{Smooth{{0, 0}, m(64), 16}, 0}, Operation{road, 0},
                             Operation{Level{{{0, 0}}, m(200), static_cast<std::int32_t>(m(900)), 256}, 0}, Operation{Undo{1}, 0}}) {
    History::Making making = history.make(o);
    std::uint64_t steps = 1, most = 0;
    for (bool isDone = false; !isDone; ++steps) {
      const std::uint64_t before = history.looked();
      isDone = making.step(10'000);
      most = std::max(most, history.looked() - before);
    }
    ASSERT_TRUE(making.result()) << making.result().error().message;
    EXPECT_LT(most, 13'000u) << o.what.index();
    EXPECT_GT(steps, 8u) << o.what.index();
  }
}

// What was undone and not kept is in no checkpoint, nor in the one that ends with the edit itself.
TEST(History, WhicheverEditWasUndoneAndNotKept) {
  const auto terrain = terrain::create("alpine", 1).value();
  for (std::uint64_t edit = 1; edit < 40; edit += testing_support::kSanitized ? 8 : 1) {
    std::mt19937_64 random(8);
    History history(terrain);
    while (history.last() < 40) ASSERT_TRUE(history.add(randomOperation(random, {0, 0})));
    const auto before = history.layer();
    ASSERT_TRUE(history.add({Undo{edit}, 0}));
    history.takeBack(before);
    ASSERT_TRUE(history.add({Undo{edit + 1}, 0}));
    expectReplayed(terrain, history);
    ASSERT_FALSE(testing::Test::HasFailure()) << edit;
  }
}

TEST(History, ThePastIsReadInTurns) {
  const auto terrain = terrain::create("alpine", 1).value();
  std::mt19937_64 random(5);
  History first(terrain), second(terrain);
  while (first.last() < 50) ASSERT_TRUE(first.add(first.last() == 20 ? Operation{Undo{3}, 0} : randomOperation(random, {0, 0})));
  int reads = 0;
  second.restore(0, 50, first.layer(), pagesOf(operationsOf(first), 10, &reads));
  {
    History::Making making = second.make({Undo{40}, 0});
    EXPECT_FALSE(making.step(1));
    EXPECT_FALSE(making.step(1));
    EXPECT_EQ(reads, 2);
  }
  const Operation more = randomOperation(random, {0, 0});
  ASSERT_TRUE(first.add(more));
  ASSERT_TRUE(second.add(more));
  EXPECT_EQ(reads, 2) << "nothing else needs the past";
  for (const std::uint64_t edit : {40, 21, 51}) {
    ASSERT_TRUE(first.add({Undo{edit}, 0}));
    ASSERT_TRUE(second.add({Undo{edit}, 0}));
    expectSameGround(*first.layer(), *second.layer());
  }
  EXPECT_EQ(reads, 5);
}

TEST(History, APastThatIsTooShortOrTooLongIsRefused) {
  for (const std::size_t there : {4, 6}) {
    History history(terrain::create("alpine", 1).value());
    history.restore(0, 5, std::make_shared<const Layer>(), pagesOf(std::vector<Operation>(there, small(0, 0)), 3));
    for (int again = 0; again < 2; ++again)
      EXPECT_EQ(history.prepare({Undo{1}, 0}).error().message,
                "The log holds " + std::to_string(there) + " edits where there should be 5.");
  }
}

TEST(History, CheckpointsAreBounded) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  for (int k = 0; k < 16; ++k) {
    ASSERT_TRUE(history.add({Raise{{m(k), 0}, m(250), 0, 100 + k}, 0}));
    EXPECT_LE(history.checkpointBytes(), kMaxCheckpointBytes);
  }
  EXPECT_GT(history.checkpointBytes(), kMaxCheckpointBytes / 4);
  ASSERT_TRUE(history.add({Undo{14}, 0}));
  EXPECT_LE(history.checkpointBytes(), kMaxCheckpointBytes);
  expectReplayed(terrain, history);
}

std::size_t allocated() {
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

TEST(History, AMillionEditsTakeLittleMemory) {
  constexpr std::uint64_t kEdits = 200'000;
  const auto terrain = terrain::create("alpine", 1).value();
  std::mt19937_64 random(6);
  std::vector<Operation> some;
  History prepared(terrain);
  while (some.size() < 2000) some.push_back(prepared.prepare(randomOperation(random, {0, 0})).value());
  const std::size_t before = allocated();
  if (before == 0) GTEST_SKIP() << "another allocator";
  History history(terrain);
  history.restore(0, kEdits, std::make_shared<const Layer>(), [&](std::uint64_t after) -> Outcome<History::Past> {
    History::Past out{std::make_shared<const Layer>(), {}};
    for (std::uint64_t k = after; k < std::min(kEdits, after + 100); ++k) out.operations.push_back(some[k % some.size()]);
    return out;
  });
  ASSERT_TRUE(history.prepare({Undo{1}, 0}));
  const std::size_t each = (allocated() - before) / kEdits;
  EXPECT_LE(each, 150u);
  RecordProperty("bytes", static_cast<int>(each));
}

TEST(History, StampsOfZerosTakeNextToNothing) {
  const auto terrain = terrain::create("alpine", 1).value();
  const Operation stamp{Stamp{{0, 0}, 256, 256, 1, std::vector<std::int32_t>(65'536)}, 0};
  History history(terrain);
  ASSERT_TRUE(history.add(stamp));
  const std::size_t before = allocated();
  if (before == 0) GTEST_SKIP() << "another allocator";
  while (history.last() < 200) ASSERT_TRUE(history.add(stamp));
  EXPECT_LE(allocated() - before, std::size_t{1} << 20);
}

TEST(AreaIndex, FindsWhatMeetsThePosts) {
  std::mt19937_64 random(7);
  const auto number = [&](std::int64_t least, std::int64_t most) {
    return std::uniform_int_distribution<std::int64_t>(least, most)(random);
  };
  const auto posts = [&](std::int64_t side) {
    const std::int64_t x = number(-30'000, 30'000), z = number(-30'000, 30'000);
    return Posts{x, z, x + number(1, side), z + number(1, side)};
  };
  AreaIndex index;
  std::vector<Posts> all;
  for (std::uint32_t k = 0; k < 3000; ++k) {
    all.push_back(posts(std::int64_t{1} << number(1, 14)));
    index.add(k, all[k]);
  }
  for (std::uint32_t k = 2999; k >= 2900; --k) index.remove(k, all[k]);
  all.resize(2900);
  for (int n = 0; n < 300; ++n) {
    const Posts wanted = posts(std::int64_t{1} << number(1, 15));
    std::set<std::uint32_t> found, expected;
    index.forEach(wanted, [&](std::uint32_t edit, const Posts& area) {
      EXPECT_EQ(area, all[edit]);
      EXPECT_TRUE(found.insert(edit).second);
    });
    for (std::uint32_t k = 0; k < all.size(); ++k)
      if (all[k].meets(wanted)) expected.insert(k);
    EXPECT_EQ(found, expected);
  }
}

}  // namespace
}  // namespace ridgecast::edits
