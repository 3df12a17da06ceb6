// A history's layer against a plain array that applies the operations that count, one after another, to every post there is.
#include "common/edits/history.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/terrain/raster.h"

namespace ridgecast::edits {
namespace {

using lattice::Point;
using lattice::Step;

constexpr Step m(double metres) { return static_cast<Step>(metres * lattice::kStepsPerMetre); }

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

// Places within 60 m of the middle; everything stays within 110 m of it.
Operation randomOperation(std::mt19937_64& random, Point middle) {
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  const auto near = [&] { return Point{middle.x + m(uniform(-60, 60)), middle.z + m(uniform(-60, 60))}; };
  const auto material = static_cast<std::uint32_t>(random() % 9);
  switch (random() % 6) {
    case 0: {
      const Step radius = m(uniform(0.5, 20));
      return {Raise{near(), radius, static_cast<Step>(static_cast<double>(radius) * uniform(0, 1)),
                    static_cast<std::int32_t>(m(uniform(-9, 9)))},
              material};
    }
    case 1:
      return {Crater{near(), m(uniform(0.5, 20)), static_cast<std::int32_t>(m(uniform(0.1, 9)))}, material};
    case 2:
      if (random() % 2)
        return {
            Level{
                {near()}, m(uniform(1, 15)), static_cast<std::int32_t>(m(uniform(900, 1100))), static_cast<std::uint32_t>(uniform(1, 600))},
            material};
      return {Level{{near(), near(), near(), near()}, 0, static_cast<std::int32_t>(m(uniform(900, 1100))), 256}, material};
    case 3:
      return {Smooth{near(), m(uniform(0.5, 20)), static_cast<std::uint32_t>(1 + random() % 16)}, material};
    case 4: {
      Road road;
      for (int k = 0; k < 3; ++k) {
        const Point p = near();
        road.line.push_back({p.x, p.z, 0});
      }
      road.width = m(uniform(1, 10));
      return {road, material};
    }
    default: {
      Stamp stamp{near(), 5, 4, static_cast<std::uint32_t>(1 + random() % 8), {}};
      for (int k = 0; k < 20; ++k) stamp.samples.push_back(static_cast<std::int32_t>(m(uniform(-3, 3))));
      return {stamp, material};
    }
  }
}

class Histories : public testing::TestWithParam<Step> {};  // metres from 0

TEST_P(Histories, AreWhatAPlainArrayMakesOfThem) {
  const auto terrain = terrain::create("alpine", 1).value();
  const Point middle{GetParam(), -GetParam()};
  const std::int64_t x = middle.x >> kPostBits, z = middle.z >> kPostBits, reach = 260;
  const Posts posts{x - reach, z - reach, x + reach, z + reach};
  std::mt19937_64 random(static_cast<std::uint64_t>(GetParam()) + 5);
  for (int round = 0; round < 4; ++round) {
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
  const EditedTerrain edited(terrain, history.layer());
  int raised = 0;
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
        any ? own + terrain::cubicHeight(around, static_cast<std::int32_t>(x & 127), static_cast<std::int32_t>(z & 127), 128) : own;
    ASSERT_EQ(height, wanted);
    raised += height != own;
  }
  EXPECT_GT(raised, 3000);
}

TEST(History, AnEditThatWasNotKeptLeavesNothing) {
  const auto terrain = terrain::create("alpine", 1).value();
  History history(terrain);
  ASSERT_TRUE(history.add({Crater{{0, 0}, m(5), m(2)}, 0}));
  const auto before = history.layer();
  ASSERT_TRUE(history.add({Undo{1}, 0}));
  history.takeBack(before);
  EXPECT_EQ(history.last(), 1u);
  EXPECT_FALSE(history.isUndone(1));
  EXPECT_EQ(history.layer(), before);
  EXPECT_FALSE(history.prepare({Undo{2}, 0}));
}

TEST(History, AnUndoneUndoCountsAgain) {
  History history(terrain::create("alpine", 1).value());
  ASSERT_TRUE(history.add({Crater{{0, 0}, m(5), m(2)}, 0}));
  const std::uint64_t hash = history.layer()->hash();
  ASSERT_TRUE(history.add({Undo{1}, 0}));
  EXPECT_EQ(history.layer()->riseAt(0, 0), 0);
  EXPECT_NE(history.prepare({Undo{1}, 0}).error().message.find("undone already"), std::string::npos);
  ASSERT_TRUE(history.add({Undo{2}, 0}));
  EXPECT_EQ(history.layer()->hash(), hash);
}

TEST(History, RestoredWithItsLayerItIsTheSame) {
  const auto terrain = terrain::create("alpine", 1).value();
  History first(terrain), second(terrain);
  std::mt19937_64 random(4);
  std::vector<Operation> operations;
  for (int k = 0; k < 20; ++k) {
    operations.push_back(
        first.prepare(k % 5 == 4 ? Operation{Undo{static_cast<std::uint64_t>(k - 1)}, 0} : randomOperation(random, {0, 0})).value());
    ASSERT_TRUE(first.add(operations.back()));
  }
  int reads = 0;
  second.restore(20, first.layer(), [&]() -> Outcome<std::vector<Operation>> { return ++reads, operations; });
  for (int k = 0; k < 3; ++k) {
    const Operation more = first.prepare(randomOperation(random, {0, 0})).value();
    ASSERT_TRUE(first.add(more));
    ASSERT_TRUE(second.add(more));
  }
  EXPECT_EQ(reads, 0);
  EXPECT_NE(second.prepare({Undo{3}, 0}).error().message.find("undone already"), std::string::npos);
  for (const std::uint64_t edit : {2, 22}) {
    const Operation next = second.prepare({Undo{edit}, 0}).value();
    ASSERT_TRUE(first.add(next));
    ASSERT_TRUE(second.add(next));
    EXPECT_EQ(first.layer()->hash(), second.layer()->hash());
  }
  EXPECT_EQ(reads, 1);
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
