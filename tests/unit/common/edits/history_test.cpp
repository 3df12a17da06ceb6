// A history's layer against a plain array that applies the operations that count, one after another, to every post there is.
#include "common/edits/history.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/terrain/raster.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::edits {
namespace {

using lattice::Point;
using lattice::Step;

using testing_support::m;
using testing_support::randomOperation;

// A square of posts.
class Plain {
 public:
  Plain(const terrain::Terrain& terrain, const Posts& posts) : posts_(posts), own_(static_cast<std::size_t>(posts.count())), rise_(own_) {
    std::vector<Step> x, z;
    for (std::int64_t b = posts.z0; b < posts.z1; ++b)
      for (std::int64_t a = posts.x0; a < posts.x1; ++a) x.push_back(a * kPostSteps), z.push_back(b * kPostSteps);
    terrain.heightSteps(x, z, own_);
  }
  void apply(const Operation& o) {
    if (const auto* smooth = std::get_if<Smooth>(&o.what)) return applySmooth(*smooth);
    if (std::holds_alternative<Undo>(o.what)) return;
    const Brush brush(o);
    for (std::size_t k = 0; k < rise_.size(); ++k)
      if (const auto result = brush.at(post(k), own_[k] + rise_[k])) rise_[k] = result->height - own_[k];
  }
  const std::vector<std::int32_t>& rise() const { return rise_; }
  Point post(std::size_t k) const {
    const auto columns = static_cast<std::size_t>(posts_.x1 - posts_.x0);
    return {(posts_.x0 + static_cast<std::int64_t>(k % columns)) * kPostSteps,
            (posts_.z0 + static_cast<std::int64_t>(k / columns)) * kPostSteps};
  }

 private:
  void applySmooth(const Smooth& o) {
    const auto columns = posts_.x1 - posts_.x0, rows = posts_.z1 - posts_.z0;
    std::vector<std::int64_t> h(rise_.size()), before;
    for (std::size_t k = 0; k < h.size(); ++k) h[k] = own_[k] + rise_[k];
    const auto start = h;
    for (std::uint32_t pass = 0; pass < o.passes; ++pass) {
      before = h;
      for (std::int64_t b = 1; b + 1 < rows; ++b)
        for (std::int64_t a = 1; a + 1 < columns; ++a) {
          std::int64_t sum = 8;
          for (std::int64_t j = -1; j <= 1; ++j)
            for (std::int64_t i = -1; i <= 1; ++i)
              sum += before[static_cast<std::size_t>((b + j) * columns + a + i)] * (2 - std::abs(i)) * (2 - std::abs(j));
          h[static_cast<std::size_t>(b * columns + a)] = sum >> 4;
        }
    }
    for (std::size_t k = 0; k < h.size(); ++k) {
      const Point p = post(k);
      const Step dx = p.x - o.at.x, dz = p.z - o.at.z;
      if (dx * dx + dz * dz <= o.radius * o.radius) rise_[k] += static_cast<std::int32_t>(h[k] - start[k]);
    }
  }
  Posts posts_;
  std::vector<std::int32_t> own_, rise_;
};

class Histories : public testing::TestWithParam<Step> {};  // metres from 0

TEST_P(Histories, AreWhatAPlainArrayMakesOfThem) {
  const auto terrain = terrain::create("alpine", 1).value();
  const Point middle{GetParam(), -GetParam()};
  const std::int64_t x = middle.x >> kPostBits, z = middle.z >> kPostBits, reach = 260;
  const Posts posts{x - reach, z - reach, x + reach, z + reach};
  std::mt19937_64 random(static_cast<std::uint64_t>(GetParam()) + 5);
  for (int round = 0; round < testing_support::rounds(4); ++round) {
    History history(terrain);
    for (int k = 0; k < 40; ++k) {
      const bool undoes = history.last() > 0 && random() % 4 == 0;
      Operation wanted = undoes ? Operation{Undo{1 + random() % history.last()}, 0} : randomOperation(random, middle);
      auto prepared = history.prepare(std::move(wanted));
      if (undoes && !prepared) continue;  // it was undone
      ASSERT_TRUE(prepared) << prepared.error().message;
      const auto before = history.layer();
      const auto changed = history.add(std::move(*prepared));
      ASSERT_TRUE(changed) << changed.error().message;
      // Nothing changed elsewhere.
      for (int n = 0; n < 400; ++n) {
        const std::int64_t a = posts.x0 + static_cast<std::int64_t>(random() % 520),
                           b = posts.z0 + static_cast<std::int64_t>(random() % 520);
        if (a >= changed->x0 && a < changed->x1 && b >= changed->z0 && b < changed->z1) continue;
        ASSERT_EQ(before->riseAt(a, b), history.layer()->riseAt(a, b));
      }
    }
    Plain plain(*terrain, posts);
    for (std::uint64_t n = 1; n <= history.last(); ++n)
      if (!history.isUndone(n)) plain.apply(history.operation(n));
    for (std::size_t k = 0; k < plain.rise().size(); ++k) {
      const Point p = plain.post(k);
      ASSERT_EQ(history.layer()->riseAt(p.x >> kPostBits, p.z >> kPostBits), plain.rise()[k]) << k;
    }

    // Undone altogether, the bits are the terrain's own, and nothing is kept.
    for (std::uint64_t n = history.last(); n > 0; --n)
      if (!history.isUndone(n) && !std::holds_alternative<Undo>(history.operation(n).what)) {
        ASSERT_TRUE(history.add({Undo{n}, 0}));
      }
    EXPECT_EQ(history.layer()->tiles(), 0u);
    EXPECT_EQ(history.layer()->bytes(), 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(NearAndFar, Histories, testing::Values(0, m(1e9), m(4e12)));

TEST(History, HeightsBetweenPostsAreBicubic) {
  const auto terrain = terrain::create("canyon", 2).value();
  History history(terrain);
  std::mt19937_64 random(9);
  for (int k = 0; k < 12; ++k) ASSERT_TRUE(history.add(history.prepare(randomOperation(random, {m(5000), m(700)})).value()));
  const Layer& layer = *history.layer();
  std::size_t wide = 0;
  for (const TileAddress a : layer.addresses()) wide += layer.tile(a)->isWide();
  EXPECT_GT(wide, 50u);
  EXPECT_GT(layer.tiles() - wide, 50u);
  const EditedTerrain edited(terrain, history.layer());
  int raised = 0;
  struct Place {
    Step x, z;
    float height;
  };
  std::vector<Place> places;
  for (int k = 0; k < 20'000; ++k) {
    const Step x = m(4880) + static_cast<Step>(random() % 61'440), z = m(580) + static_cast<Step>(random() % 61'440);
    std::array<std::int32_t, 16> around;
    bool any = false;
    for (std::int64_t j = 0; j < 4; ++j)
      for (std::int64_t i = 0; i < 4; ++i)
        any = (around[static_cast<std::size_t>(4 * j + i)] = layer.riseAt((x >> 7) - 1 + i, (z >> 7) - 1 + j)) != 0 || any;
    float own = 0, height = 0;
    terrain->heights({&x, 1}, {&z, 1}, {&own, 1});
    edited.heights({&x, 1}, {&z, 1}, {&height, 1});
    const float wanted =
        any ? own + terrain::cubicHeight(around, static_cast<float>(x & 127), static_cast<float>(z & 127), 1 / 128.0f, 1 / 128.0f) : own;
    ASSERT_EQ(height, wanted);
    raised += height != own;
    places.push_back({x, z, wanted});
  }
  EXPECT_GT(raised, 3000);
  // Whoever asks for many at a time, from all over or square by square of so many metres, gets the same.
  for (const Step side : {m(1000), m(90), m(32), m(8), m(2)}) {
    std::ranges::stable_sort(places, {}, [side](const Place& p) { return std::pair(p.x / side, p.z / side); });
    std::vector<Step> x, z;
    std::vector<float> wanted;
    for (const Place& p : places) x.push_back(p.x), z.push_back(p.z), wanted.push_back(p.height);
    std::vector<float> heights(x.size());
    edited.heights(x, z, heights);
    EXPECT_EQ(heights, wanted) << side;
  }
}

// Half of the edits were compacted: the others go on, and can be undone, as in a history that still has all of them.
TEST(History, GoesOnAfterCompactedEdits) {
  const auto terrain = terrain::create("alpine", 1).value();
  History whole(terrain);
  std::mt19937_64 random(6);
  std::vector<Operation> later;
  std::shared_ptr<const Layer> base;
  for (std::uint64_t k = 1; k <= 40; ++k) {
    Operation wanted = k % 7 == 0 && k > 21 ? Operation{Undo{k - 2}, 0} : randomOperation(random, {0, 0});
    const Operation made = whole.prepare(std::move(wanted)).value();
    ASSERT_TRUE(whole.add(made));
    if (k > 20) later.push_back(made);
    if (k == 20) base = whole.layer();
  }
  History compacted(terrain);
  compacted.restore(20, 40, std::make_shared<const Layer>(), [&](std::uint64_t) {
    return Outcome<History::Past>(History::Past{base, later});
  });
  ASSERT_TRUE(compacted.replay());
  EXPECT_EQ(compacted.layer()->hash(), whole.layer()->hash());
  EXPECT_EQ(compacted.prepare({Undo{17}, 0}).error().message, "Edit 17 was compacted and cannot be undone.");
  for (const std::uint64_t edit : {21, 22, 39, 40, 41}) {
    auto undo = compacted.prepare({Undo{edit}, 0});
    if (!undo) continue;
    ASSERT_TRUE(compacted.add(*undo));
    ASSERT_TRUE(whole.add(*undo));
    EXPECT_EQ(compacted.layer()->hash(), whole.layer()->hash()) << edit;
  }
  EXPECT_GT(compacted.last(), 43u);
}

// An edit counts when no undo of it counts, whether it was made here or is read back.
TEST(History, UndoesOfUndoesAndOfTheSame) {
  const auto terrain = terrain::create("alpine", 1).value();
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    std::mt19937_64 random(seed);
    History first(terrain), second(terrain);
    std::vector<Operation> operations;
    while (first.last() < 30) {
      auto made =
          first.prepare(random() % 3 == 0 || first.last() == 0 ? Operation{Raise{{static_cast<Step>(random() % 9999), 0}, m(3), 0, 100}, 0}
                                                               : Operation{Undo{1 + random() % first.last()}, 0});
      if (!made) continue;
      operations.push_back(*made);
      ASSERT_TRUE(first.add(std::move(*made)));
    }
    second.restore(0, 30, nullptr, [&](std::uint64_t) {
      return Outcome<History::Past>(History::Past{std::make_shared<const Layer>(), operations});
    });
    ASSERT_TRUE(second.replay());
    std::vector<bool> counts(31, true);
    for (std::uint64_t k = 30; k > 0; --k) {
      const auto* const undo = std::get_if<Undo>(&operations[k - 1].what);
      if (undo && counts[k]) counts[undo->edit] = false;
    }
    History plain(terrain);
    for (std::uint64_t k = 1; k <= 30; ++k) {
      EXPECT_EQ(first.isUndone(k), !counts[k]) << seed << " " << k;
      EXPECT_EQ(second.isUndone(k), !counts[k]) << seed << " " << k;
      EXPECT_EQ(first.prepare({Undo{k}, 0}).has_value(), counts[k]) << "undone already";
      if (counts[k] && std::holds_alternative<Raise>(operations[k - 1].what)) {
        ASSERT_TRUE(plain.add(operations[k - 1]));
      }
    }
    for (const History* history : {&first, &second}) EXPECT_EQ(history->layer()->hash(), plain.layer()->hash()) << seed;
  }
}

TEST(History, RefusesAPastThatUndoesWhatIsNotThere) {
  for (const std::uint64_t edit : {3, 7, 8, 9, 1000}) {
    History history(terrain::create("alpine", 1).value());
    history.restore(5, 8, nullptr, [&](std::uint64_t) -> Outcome<History::Past> {
      const Operation crater{Crater{{0, 0}, m(5), m(2)}, 0};
      return History::Past{std::make_shared<const Layer>(), {crater, {Undo{edit}, 0}, crater}};
    });
    EXPECT_THAT(history.replay().error().message, testing::HasSubstr("undoes edit " + std::to_string(edit) + ", which is not there"));
  }
}

TEST(History, MemoryIsBounded) {
  History history(terrain::create("alpine", 1).value(), std::size_t{1} << 20);
  int added = 0;
  Outcome<Posts> last = Posts();
  for (; added < 1000; ++added) {
    last = history.add({Crater{{added * m(5000), 0}, m(10), m(2)}, 0});
    if (!last) break;
  }
  EXPECT_GT(added, 10);
  ASSERT_FALSE(last);
  EXPECT_NE(last.error().message.find("1 MiB"), std::string::npos);
  EXPECT_LE(history.layer()->bytes(), std::size_t{1} << 20);
  EXPECT_TRUE(history.add({Undo{1}, 0}));  // makes room
  EXPECT_TRUE(history.add({Crater{{-m(5000), 0}, m(10), m(2)}, 0}));
}

}  // namespace
}  // namespace ridgecast::edits
