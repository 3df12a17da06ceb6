#include "server/quadtree/quadtree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "server/generation/grid.h"
#include "tests/support/sanitized.h"

namespace ridgecast::quadtree {
namespace {

using lattice::LeafAddress;
using lattice::Step;

camera::Pose poseAt(double x, double z, double y) {
  camera::Pose p;
  p.x = static_cast<Step>(x * 256);
  p.z = static_cast<Step>(z * 256);
  p.y = y;
  return p;
}

// Whether the closed squares share at least a point.
bool touch(LeafAddress a, LeafAddress b) {
  return a.x() <= b.x() + b.side() && b.x() <= a.x() + a.side() && a.z() <= b.z() + b.side() && b.z() <= a.z() + a.side();
}

// Every leaf of the tree, in canonical order, as points find them.
std::vector<LeafAddress> leavesOf(const Quadtree& tree) {
  std::vector<LeafAddress> out, squares = tree.roots();
  while (!squares.empty()) {
    const LeafAddress square = squares.back();
    squares.pop_back();
    LeafAddress leaf;
    if (tree.leafAt({square.x(), square.z()}, leaf) && leaf == square) {
      out.push_back(square);
    } else if (square.level > 0) {
      for (int k = 0; k < 4; ++k) squares.push_back(square.child(k));
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

class Quadtrees : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Origins, Quadtrees, testing::Values(0.0, 1e6, 1e8, -1e12, 4e12));

TEST_P(Quadtrees, LeavesTileTheWorldToTheHorizonAndTouchingOnesDifferByOneLevelAtMost) {
  Quadtree tree;
  std::mt19937 rng(3);
  const double origin = GetParam();
  double x = origin, z = -origin;
  for (int step = 0; step < 25; ++step) {
    const double y = step % 5 == 4 ? 8000 : 200;
    tree.follow(poseAt(x, z, y), 100);
    const auto leaves = leavesOf(tree);
    ASSERT_LE(leaves.size(), 2000u);
    // Tiling: areas add up and no leaf is inside another; every point within the horizon has a leaf.
    std::set<std::pair<std::int64_t, std::int64_t>> roots;
    double area = 0;
    for (LeafAddress a : leaves) {
      roots.insert({a.i >> (kRootLevel - a.level), a.j >> (kRootLevel - a.level)});
      area += std::ldexp(1.0, 2 * a.level);
      ASSERT_TRUE(tree.isLeaf(a));
      ASSERT_FALSE(a.level < kRootLevel && tree.isLeaf(a.parent()));
    }
    EXPECT_EQ(area, static_cast<double>(roots.size()) * std::ldexp(1.0, 2 * kRootLevel));
    for (int n = 0; n < 200; ++n) {
      const double angle = rng() * 1e-9, radius = std::sqrt(rng() / 4294967296.0) * (kHorizon - 1);
      LeafAddress leaf;
      const lattice::Point p{static_cast<Step>(x * 256 + 256 * radius * std::cos(angle)),
                             static_cast<Step>(z * 256 + 256 * radius * std::sin(angle))};
      ASSERT_TRUE(tree.leafAt(p, leaf));
      EXPECT_TRUE(leaf.contains(p));
      EXPECT_TRUE(tree.isLeaf(leaf));
    }
    // Touching leaves, against every pair.
    for (std::size_t k = 0; k < leaves.size(); ++k) tree.setTag(leaves[k], static_cast<std::uint32_t>(k + 1));
    for (std::size_t k = step % 17; k < leaves.size(); k += 17) {
      std::vector<std::uint32_t> expected, around;
      for (std::size_t other = 0; other < leaves.size(); ++other)
        if (other != k && touch(leaves[other], leaves[k])) {
          expected.push_back(static_cast<std::uint32_t>(other + 1));
          EXPECT_LE(std::abs(leaves[other].level - leaves[k].level), 1);
        }
      tree.touchingTags(leaves[k], around);
      EXPECT_EQ(around, expected);
    }
    x += static_cast<double>(rng() % 3000) - 500;
    z += static_cast<double>(rng() % 3000) - 1500;
  }
}

TEST(Quadtree, EndsWhereTheLatticeDoes) {
  constexpr Step kEdge = lattice::kMaxPosition, kHorizonSteps = static_cast<Step>(kHorizon * lattice::kStepsPerMetre);
  std::mt19937_64 random(4);
  for (const lattice::Point at : {lattice::Point{kEdge, kEdge}, {-kEdge, kEdge}, {kEdge, 0}, {5, -kEdge}}) {
    Quadtree tree;
    camera::Pose pose = poseAt(0, 0, 300);
    pose.x = at.x, pose.z = at.z;
    tree.follow(pose, 100);
    for (const LeafAddress leaf : leavesOf(tree)) {
      EXPECT_TRUE(lattice::addressIsValid(leaf) && lattice::positionIsValid(leaf.x(), leaf.z()) &&
                  lattice::positionIsValid(leaf.x() + leaf.side(), leaf.z() + leaf.side()))
          << leaf.level << " " << leaf.i << " " << leaf.j;
    }
    for (int k = 0; k < 1000; ++k) {
      const auto near = [&](Step from) {
        const Step offset = static_cast<Step>(random() % static_cast<std::uint64_t>(kHorizonSteps)) - kHorizonSteps / 2;
        return std::clamp(from + offset, -kEdge, kEdge - 1);
      };
      LeafAddress leaf;
      EXPECT_TRUE(tree.leafAt({near(at.x), near(at.z)}, leaf));
    }
  }
}

TEST(Quadtree, TheFinestLeafIsUnderACameraAtTheGroundAndLeavesGrowWithDistance) {
  Quadtree tree;
  tree.follow(poseAt(10, 10, 2), 0);
  LeafAddress leaf;
  ASSERT_TRUE(tree.leafAt({2560, 2560}, leaf));
  EXPECT_EQ(leaf.level, 0);
  for (LeafAddress a : leavesOf(tree)) {
    const double side = static_cast<double>(a.side()) / 256;
    const auto gap = [](double p, double low, double high) { return p < low ? low - p : p > high ? p - high : 0; };
    const double x = static_cast<double>(a.x()) / 256, z = static_cast<double>(a.z()) / 256;
    const double d = std::hypot(gap(10, x, x + side), gap(10, z, z + side), 2.0);
    EXPECT_TRUE(a.level == 0 || side <= kSplit * d);
  }
}

TEST(Quadtree, AStillOrTremblingCameraChangesNothing) {
  Quadtree tree;
  EXPECT_TRUE(tree.follow(poseAt(1000, 500, 100), 0));
  EXPECT_FALSE(tree.follow(poseAt(1000, 500, 100), 0));
  int changes = 0;
  for (int n = 0; n < 100; ++n) changes += tree.follow(poseAt(1000 + (n % 2), 500, 100), 0);
  EXPECT_LE(changes, 2);
}

// The rules as they are written, every node looked at every time.
class Plain {
 public:
  void follow(const camera::Pose& pose, double ground) {
    pose_ = pose;
    above_ = std::max(0.0, pose.y - ground);
    leaves.clear();
    std::set<LeafAddress> now;
    const LeafAddress centre = lattice::leafAt({pose.x, pose.z}, kRootLevel);
    for (std::int64_t i = centre.i - 6; i <= centre.i + 6; ++i)
      for (std::int64_t j = centre.j - 6; j <= centre.j + 6; ++j) {
        const LeafAddress root{kRootLevel, i, j};
        const double flat = distance(root);
        if (flat <= kHorizon || (flat <= kKeepDistance && roots_.count(root))) {
          now.insert(root);
          add(root);
        }
      }
    roots_ = now;
    split_ = std::move(kept_);
    kept_.clear();
  }
  std::set<LeafAddress> leaves;

 private:
  double distance(LeafAddress a) const {
    const auto gap = [](double p, double low, double high) { return p < low ? low - p : p > high ? p - high : 0; };
    const double x0 = static_cast<double>(a.x()), z0 = static_cast<double>(a.z()), side = static_cast<double>(a.side());
    return std::hypot(gap(static_cast<double>(pose_.x), x0, x0 + side), gap(static_cast<double>(pose_.z), z0, z0 + side)) / 256;
  }
  void add(LeafAddress a) {
    const double side = static_cast<double>(a.side()) / 256, away = std::hypot(distance(a), above_);
    if (a.level > 0 && away < side / (split_.count(a) ? kMerge : kSplit)) {
      kept_.insert(a);
      for (int k = 0; k < 4; ++k) add(a.child(k));
    } else {
      leaves.insert(a);
    }
  }
  camera::Pose pose_;
  double above_ = 0;
  std::set<LeafAddress> roots_, split_, kept_;
};

// Steps, strides, dives and jumps: looking only at what may change changes nothing, and what came and went is told.
TEST_P(Quadtrees, LooksOnlyAtWhatMayChange) {
  Quadtree tree;
  Plain plain;
  std::mt19937 rng(11);
  double x = GetParam(), z = 7, y = 200;
  std::map<LeafAddress, std::uint32_t> tags;
  std::uint32_t next = 1;
  std::size_t changed = 0;
  for (int n = 0; n < testing_support::rounds(600); ++n) {
    const auto pose = poseAt(x, z, y);
    const bool told = tree.follow(pose, 100);
    plain.follow(pose, 100);
    const auto leaves = leavesOf(tree);
    ASSERT_EQ(std::set<LeafAddress>(leaves.begin(), leaves.end()), plain.leaves) << "step " << n;
    std::vector<LeafAddress> made;
    std::vector<std::uint32_t> gone;
    for (LeafAddress a : leaves)
      if (!tags.count(a)) made.push_back(a);
    for (auto it = tags.begin(); it != tags.end();) {
      if (plain.leaves.count(it->first)) {
        ++it;
        continue;
      }
      gone.push_back(it->second);
      it = tags.erase(it);
    }
    auto toldGone = tree.gone();
    std::sort(gone.begin(), gone.end());
    std::sort(toldGone.begin(), toldGone.end());
    ASSERT_EQ(tree.made(), made) << "step " << n;
    ASSERT_EQ(toldGone, gone) << "step " << n;
    ASSERT_EQ(told, !made.empty() || !gone.empty());
    changed += told;
    for (LeafAddress a : made) tree.setTag(a, tags[a] = next++);
    for (std::size_t k = n % 29; k < leaves.size(); k += 29) {
      std::vector<std::uint32_t> expected, around;
      for (LeafAddress a : leaves)
        if (!(a == leaves[k]) && touch(a, leaves[k])) expected.push_back(tags[a]);
      std::sort(expected.begin(), expected.end());
      tree.touchingTags(leaves[k], around);
      ASSERT_EQ(around, expected);
    }
    const int kind = n % 100;
    const double stride = kind < 40 ? 0.02 : kind < 70 ? 5 : kind < 97 ? 150 : 3000;
    x += stride * (static_cast<double>(rng() % 1000) / 500 - 0.9);
    z += stride * (static_cast<double>(rng() % 1000) / 500 - 1.1);
    y = std::max(90.0, y + stride * (static_cast<double>(rng() % 1000) / 500 - 1));
    if (kind == 98) y = 6000;
    if (kind == 99) y = 150;
    if (n == testing_support::rounds(350)) x += 3e9;  // farther than the sum of all ways is kept exactly
  }
  EXPECT_GT(changed, testing_support::kSanitized ? 15u : 150u);
}

TEST(Quadtree, TagsStayWithTheirLeavesAndNewLeavesHaveNone) {
  Quadtree tree;
  tree.follow(poseAt(0, 0, 100), 0);
  std::uint32_t next = 1;
  std::map<LeafAddress, std::uint32_t> tags;
  for (int step = 0; step < 40; ++step) {
    const auto leaves = leavesOf(tree);
    const std::set<LeafAddress> now(leaves.begin(), leaves.end());
    for (auto it = tags.begin(); it != tags.end();) it = now.count(it->first) ? std::next(it) : tags.erase(it);
    for (LeafAddress a : leaves) {
      if (tags.count(a)) {
        EXPECT_EQ(tree.tag(a), tags[a]);
      } else {
        EXPECT_EQ(tree.tag(a), 0u);
        tree.setTag(a, tags[a] = next++);
      }
      EXPECT_EQ(tree.tagAt({a.x(), a.z()}), tags[a]);
      EXPECT_EQ(tree.tagAt({a.x() + a.side() - 1, a.z() + a.side() - 1}), tags[a]);
    }
    tree.follow(poseAt(step * 700.0, step * -300.0, 100), 0);
  }
}

TEST(Grid, PointsNestAndAreFoundAgain) {
  const LeafAddress leaf{3, -5, 7};
  std::set<lattice::Point> fine;
  for (int k = 0; k < 4; ++k)
    for (lattice::Point p : generation::gridPoints(leaf.child(k))) fine.insert(p);
  EXPECT_EQ(fine.size(), 25u);
  for (lattice::Point p : generation::gridPoints(leaf)) EXPECT_TRUE(fine.count(p));
  Quadtree tree;
  tree.follow(poseAt(0, 0, 50), 0);
  std::set<lattice::Point> all;
  for (LeafAddress a : leavesOf(tree))
    for (lattice::Point p : generation::gridPoints(a)) all.insert(p);
  for (lattice::Point p : all) {
    EXPECT_TRUE(generation::isGridPoint(tree, p));
    EXPECT_FALSE(generation::isGridPoint(tree, {p.x + 1, p.z}));
  }
  std::mt19937 rng(1);
  for (int n = 0; n < 2000; ++n) {
    const lattice::Point p{(static_cast<Step>(rng() % 1024) - 512) * 4096, (static_cast<Step>(rng() % 1024) - 512) * 4096};
    EXPECT_EQ(generation::isGridPoint(tree, p), all.count(p) == 1);
  }
}

}  // namespace
}  // namespace ridgecast::quadtree
