// A client keeps to its bounds and to the truth whatever points a server sends.
#include "client/core/mesh/point_mesh.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "tests/support/leaf_meshes.h"

namespace ridgecast::core {
namespace {

using lattice::LeafAddress;
using support::between;
using support::Random;

// A payload that changes one square of many points, all at height 0.
std::vector<std::uint8_t> payloadOf(const std::vector<LeafAddress>& held, const std::vector<LeafAddress>& come,
                                    const points::Change& change, std::uint32_t before) {
  std::vector<std::uint8_t> payload;
  points::Writer writer(payload);
  std::vector<points::Change> changes{change};
  writer.changes(
      {held, come, {}}, [&](const LeafAddress&) { return before; }, changes);
  for (std::size_t k = 0; k < change.inserted.size(); ++k) writer.inserted(change.square.level, 0, k > 2, 0);
  writer.finish();
  return payload;
}

const LeafAddress kLeaf{4, 0, 0};

std::vector<points::Place> sorted(std::vector<points::Place> places) {
  std::ranges::sort(places);
  places.erase(std::unique(places.begin(), places.end()), places.end());
  return places;
}

std::vector<points::Place> randomPlaces(Random& random, int count) {
  const auto coordinate = [&random] { return static_cast<std::int32_t>(between(random, 0, kLeaf.side() - 1)); };
  std::vector<points::Place> places;
  for (int k = 0; k < count; ++k) places.push_back({coordinate(), coordinate()});
  return sorted(std::move(places));
}

bool follows(PointMesh& mesh, const std::vector<points::Place>& places) {
  const std::vector<LeafAddress> come{kLeaf};
  return mesh.follow({{}, come, payloadOf(come, come, {kLeaf, {}, {}, places}, 0), {}});
}

TEST(PointMesh, TrianglesHaveNoPointInTheirCircleWhateverIsTakenBack) {
  Random random(1);
  PointMesh mesh(false);
  const std::vector<points::Place> places = randomPlaces(random, 300);
  ASSERT_TRUE(follows(mesh, places));
  // Every third goes.
  points::Change change{kLeaf, {}, {}, {}};
  std::vector<points::Place> stay;
  for (std::uint32_t k = 0; k < places.size(); ++k)
    if (k % 3 == 0)
      change.removed.push_back(k);
    else
      stay.push_back(places[k]);
  ASSERT_TRUE(mesh.follow({{}, {}, payloadOf({kLeaf}, {}, change, static_cast<std::uint32_t>(places.size())), {}}));
  const mesh::LeafMesh leaf = mesh.extract(kLeaf).mesh;
  EXPECT_GT(leaf.triangles.size(), 300u);
  for (const mesh::Triangle& t : leaf.triangles) {
    const auto at = [&](std::size_t k) { return leaf.vertices[t[k]]; };
    for (const points::Place& p : stay) {
      using Wide = __int128;
      Wide m[3][3];
      for (std::size_t k = 0; k < 3; ++k) {
        const Wide x = at(k).x - p.x, z = at(k).z - p.z;
        m[k][0] = x, m[k][1] = z, m[k][2] = x * x + z * z;
      }
      const Wide inside = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                          m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
      EXPECT_GE(inside, 0);  // x and z: clockwise is positive
    }
  }
}

// What somebody draws who keeps a copy of the slots: the leaves' triangles, although only what changed is told.
class Copy {
 public:
  void follow(PointMesh& mesh) {
    const std::vector<PointMesh::Changed> changed = mesh.takeChanged();
    PointMesh::Drawing drawing;
    mesh.draw(changed, drawing);
    told_ = drawing.changed.size();
    ASSERT_EQ(drawing.corners.size(), 3 * told_);
    for (std::size_t k = 0; k < told_; ++k) std::copy_n(&drawing.corners[3 * k], 3, slots_[drawing.changed[k]].begin());
    ASSERT_EQ(drawing.ends.size(), changed.size());
    std::size_t at = 0;
    for (std::size_t n = 0; n < changed.size(); ++n) {
      mesh::LeafMesh leaf{changed[n].leaf, {}, {}};
      for (; at < drawing.ends[n]; ++at)
        for (std::uint32_t k = 0; k < PointMesh::kBlock; ++k) add(slots_[drawing.blocks[at] * PointMesh::kBlock + k], leaf);
      EXPECT_EQ(leaf.triangles.size(), changed[n].triangles);
      EXPECT_EQ(mesh::hashLeaf(leaf), mesh::hashLeaf(mesh.extract(changed[n].leaf).mesh)) << changed[n].leaf.i << ' ' << changed[n].leaf.j;
    }
  }
  std::size_t told() const { return told_; }
  std::size_t slots() const { return slots_.size(); }

 private:
  using Slot = std::array<mesh::LocalVertex, 3>;
  static void add(const Slot& slot, mesh::LeafMesh& leaf) {
    if (slot == Slot{}) return;
    const auto n = static_cast<std::uint32_t>(leaf.vertices.size());
    leaf.vertices.insert(leaf.vertices.end(), slot.begin(), slot.end());
    leaf.triangles.push_back({n, n + 1, n + 2});
  }
  std::map<std::uint32_t, Slot> slots_;
  std::size_t told_ = 0;
};

TEST(PointMesh, ACopyOfTheSlotsThatChangeDrawsTheLeaves) {
  Random random(2);
  PointMesh mesh(false);
  std::vector<points::Place> places = randomPlaces(random, 3000);
  const LeafAddress stays{4, 1, 0};
  const std::vector<LeafAddress> parent{kLeaf}, children{{3, 0, 0}, {3, 0, 1}, {3, 1, 0}, {3, 1, 1}}, whole{kLeaf, stays};
  ASSERT_TRUE(mesh.follow({{}, whole, payloadOf(whole, whole, {kLeaf, {}, {}, places}, 0), {}}));
  Copy copy;
  copy.follow(mesh);
  const auto turn = [&](const std::vector<LeafAddress>& gone, const std::vector<LeafAddress>& come) {
    std::vector<std::uint8_t> payload;
    points::Writer writer(payload);
    std::vector<LeafAddress> held = come;
    held.push_back(stays);
    std::vector<points::Change> none;
    writer.changes(
        {held, come, {}}, [](const LeafAddress&) { return 0; }, none);
    writer.finish();
    EXPECT_TRUE(mesh.follow({gone, come, payload, {}}));
    copy.follow(mesh);
  };
  for (int n = 0; n < 8; ++n) {
    const auto first = static_cast<std::uint32_t>(between(random, 0, static_cast<std::int64_t>(places.size()) - 4));
    const points::Change change{kLeaf, {first, first + 2, first + 3}, {}, {}};
    ASSERT_TRUE(mesh.follow({{}, {}, payloadOf(whole, {}, change, static_cast<std::uint32_t>(places.size())), {}}));
    for (std::uint32_t k : {3u, 2u, 0u}) places.erase(places.begin() + first + k);
    copy.follow(mesh);
    EXPECT_LT(copy.told(), copy.slots() / 20);
    turn(parent, children);
    turn(children, parent);
  }
}

TEST(PointMesh, TellsOfEachLeafThatComesAlsoOfAnEmptyOne) {
  PointMesh mesh(false);
  ASSERT_TRUE(follows(mesh, {{0, 0}, {0, 1024}, {1024, 0}}));
  EXPECT_EQ(mesh.takeChanged().size(), 1u);
  const std::vector<LeafAddress> come{{4, 3, 3}}, held{kLeaf, come.front()};
  ASSERT_TRUE(mesh.follow({{}, come, payloadOf(held, come, {kLeaf, {}, {}, {{512, 512}}}, 3), {}}));
  const auto changed = mesh.takeChanged();
  ASSERT_EQ(changed.size(), 2u);
  EXPECT_NE(changed[0].hash, 0u);
  EXPECT_EQ(changed[1].leaf, come.front());
  EXPECT_EQ(changed[1].hash, 0u);
  EXPECT_TRUE(mesh.takeChanged().empty());
}

TEST(PointMesh, RefusesWhatIsNotThereOrThereAlready) {
  PointMesh mesh(false);
  const std::vector<points::Place> corners{{0, 0}, {0, 1024}, {1024, 0}};
  ASSERT_TRUE(follows(mesh, corners));
  EXPECT_FALSE(mesh.follow({{}, {}, payloadOf({kLeaf}, {}, {kLeaf, {}, {}, {{0, 1024}}}, 3), {}})) << "there already";
  mesh.clear();
  EXPECT_FALSE(follows(mesh, {{0, 0}, {0, 512}, {0, 1024}})) << "on one line";
  mesh.clear();
  ASSERT_TRUE(follows(mesh, corners));
  const std::vector<LeafAddress> other{{4, 9, 9}};
  EXPECT_FALSE(mesh.follow({other, {}, payloadOf({kLeaf}, {}, {kLeaf, {0}, {}, {}}, 3), {}})) << "a leaf that is not held goes";
  mesh.clear();
  ASSERT_TRUE(follows(mesh, corners));
  EXPECT_FALSE(mesh.follow({{}, {}, payloadOf({kLeaf}, {}, {kLeaf, {0}, {}, {}}, 3), {}})) << "what is left lies on one line";
}

TEST(PointMesh, EndsWorkThatCostsTheSquareOfItsPoints) {
  // Points on a parabola, then points beside its axis, each of whose circles holds most of the triangles.
  PointMesh mesh(false);
  std::vector<points::Place> places;
  for (std::int32_t k = 0; k < 300; ++k) places.push_back({k * k, 64 * k});
  const std::size_t arc = places.size();
  for (std::int32_t k = 0; k < 30'000; ++k) places.push_back({131'000 - k, 131'071 - (k % 3)});
  EXPECT_GT(places.size(), arc);
  const bool done = follows(mesh, sorted(places));  // cheap or refused, but at once
  if (!done) mesh.clear();
  std::vector<points::Place> fan;  // one point with 20,000 around it, which goes
  for (int k = 0; k < 20'000; ++k)
    fan.push_back({65'536 + static_cast<std::int32_t>(60'000 * std::cos(k * 3.14159265e-4)),
                   65'536 + static_cast<std::int32_t>(60'000 * std::sin(k * 3.14159265e-4))});
  fan.push_back({65'536, 65'536});
  fan = sorted(fan);
  mesh.clear();
  ASSERT_TRUE(follows(mesh, fan));
  const auto centre = static_cast<std::uint32_t>(std::ranges::find(fan, points::Place{65'536, 65'536}) - fan.begin());
  EXPECT_FALSE(mesh.follow({{}, {}, payloadOf({kLeaf}, {}, {kLeaf, {centre}, {}, {}}, static_cast<std::uint32_t>(fan.size())), {}}));
}

}  // namespace
}  // namespace ridgecast::core
