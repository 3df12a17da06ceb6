// The scene applies iterations all or nothing, and holds what a plain replica of the same iterations holds.
#include "client/core/mesh/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <future>

#include "common/codec/codec.h"
#include "common/mesh/leaf_mesh.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast {
namespace {

using core::Scene;
using support::between;
using support::Random;
using Replica = std::map<lattice::LeafAddress, mesh::LeafMesh>;

wire::LeafWhole wholeOf(const mesh::LeafMesh& leaf) {
  return {.address = leaf.address,
          .vertices = static_cast<std::uint32_t>(leaf.vertices.size()),
          .triangles = static_cast<std::uint32_t>(leaf.triangles.size()),
          .payload = codec::encodeLeaf(leaf)};
}

mesh::LeafMesh leafAt(Random& random, lattice::LeafAddress address, int n) {
  mesh::LeafMesh leaf = n == 0 ? mesh::LeafMesh{} : support::terrainLike(random, n, 0);
  leaf.address = address;
  return leaf;
}

std::uint64_t hashOf(const Replica& replica) {
  std::uint64_t sum = 0;
  for (const auto& [address, leaf] : replica) sum += mesh::hashTerm(address, mesh::hashLeaf(leaf));
  return sum;
}

void expectHolds(const Scene& scene, const Replica& replica, std::uint64_t iteration) {
  std::uint64_t triangles = 0;
  ASSERT_EQ(scene.leaves().size(), replica.size());
  auto held = scene.leaves().begin();
  for (const auto& [address, leaf] : replica) {
    ASSERT_EQ(held->first, address);
    EXPECT_TRUE(*held->second.mesh == leaf);
    EXPECT_EQ(held->second.hash, mesh::hashLeaf(leaf));
    for (const mesh::LocalVertex& v : leaf.vertices) {
      EXPECT_TRUE(v.x >= held->second.low.x && v.z >= held->second.low.z && v.y >= held->second.low.y);
      EXPECT_TRUE(v.x <= held->second.high.x && v.z <= held->second.high.z && v.y <= held->second.high.y);
    }
    triangles += leaf.triangles.size();
    ++held;
  }
  EXPECT_EQ(scene.triangles(), triangles);
  EXPECT_EQ(scene.hash(), hashOf(replica));
  EXPECT_EQ(scene.iteration(), iteration);
}

wire::Iteration iterationOf(std::uint64_t number) {
  wire::Iteration it;
  it.number = number;
  return it;
}

struct Fixture {
  Random random{7};
  Scene scene;
  Replica replica;
  std::uint64_t number = 0;

  wire::Iteration next() { return iterationOf(++number); }
  void set(wire::Iteration& it, lattice::LeafAddress address, int n) {
    mesh::LeafMesh leaf = leafAt(random, address, n);
    it.whole.push_back(wholeOf(leaf));
    replica[address] = std::move(leaf);
  }
};

TEST(Scene, HoldsWhatItWasSent) {
  Fixture f;
  for (int round = 0; round < 60; ++round) {
    wire::Iteration it = f.next();
    Replica before = f.replica;
    for (const auto& [address, leaf] : before)
      if (between(f.random, 0, 3) == 0) {
        it.gone.push_back(address);
        f.replica.erase(address);
      }
    std::set<lattice::LeafAddress> named;
    for (int k = 0; k < 4; ++k) {
      const lattice::LeafAddress address{0, between(f.random, -2, 2), between(f.random, -2, 2)};  // at times one that is gone before
      if (named.insert(address).second) f.set(it, address, static_cast<int>(between(f.random, 0, 6)));
    }
    if (round % 2 == 0) {
      const auto applied = f.scene.apply(it);
      ASSERT_TRUE(applied) << applied.error().message;
    } else {  // in two, the first beside those who read
      auto preparing = std::async(std::launch::async, [&] { return f.scene.prepare(it); });
      expectHolds(f.scene, before, f.number - 1);
      auto prepared = preparing.get();
      ASSERT_TRUE(prepared) << prepared.error().message;
      expectHolds(f.scene, before, f.number - 1);
      f.scene.take(std::move(*prepared));
    }
    expectHolds(f.scene, f.replica, f.number);
  }
}

TEST(Scene, KeepsWhatItHoldsForAnotherConnection) {
  Fixture f;
  wire::Iteration it = f.next();
  for (int k = 0; k < 4; ++k) f.set(it, {0, k, 0}, 3);
  ASSERT_TRUE(f.scene.apply(it));
  f.number = 0;
  it = f.next();
  f.set(it, {0, 2, 0}, 4);
  EXPECT_FALSE(f.scene.apply(it)) << "a number that does not follow";
  f.scene.reconnect(false);
  const auto held = f.scene.held();
  ASSERT_EQ(held.size(), 4u);
  for (const wire::HeldLeaf& leaf : held) EXPECT_EQ(leaf.hash, f.scene.leaves().at(leaf.address).hash);
  ASSERT_TRUE(f.scene.apply(it));
  expectHolds(f.scene, f.replica, 1);
}

TEST(Scene, VersionsGrowOnlyForReplacedLeaves) {
  Fixture f;
  wire::Iteration it = f.next();
  f.set(it, {0, 0, 0}, 2);
  f.set(it, {0, 1, 0}, 2);
  ASSERT_TRUE(f.scene.apply(it));
  const std::uint64_t kept = f.scene.leaves().at({0, 0, 0}).version, replaced = f.scene.leaves().at({0, 1, 0}).version;
  it = f.next();
  f.set(it, {0, 1, 0}, 3);
  ASSERT_TRUE(f.scene.apply(it));
  EXPECT_EQ(f.scene.leaves().at({0, 0, 0}).version, kept);
  EXPECT_GT(f.scene.leaves().at({0, 1, 0}).version, replaced);
  f.scene.clear();
  expectHolds(f.scene, {}, 0);
  ASSERT_TRUE(f.scene.apply(it));  // any number is the first after clear()
  EXPECT_GT(f.scene.leaves().at({0, 1, 0}).version, replaced + 1);
}

TEST(Scene, AppliesNothingOfAWrongIteration) {
  Fixture f;
  wire::Iteration first = f.next();
  for (int k = 0; k < 5; ++k) f.set(first, {0, k, 0}, 3);
  ASSERT_TRUE(f.scene.apply(first));
  expectHolds(f.scene, f.replica, 1);

  wire::Iteration good = iterationOf(2);
  good.gone = {{0, 0, 0}};
  for (int k = 3; k < 8; ++k) good.whole.push_back(wholeOf(leafAt(f.random, {0, k, 0}, 4)));
  const auto refuses = [&](const char* what, auto change) {
    wire::Iteration bad = good;
    change(bad);
    const auto applied = f.scene.apply(bad);
    ASSERT_FALSE(applied) << what;
    EXPECT_NE(applied.error().message.find(what), std::string::npos) << applied.error().message;
    expectHolds(f.scene, f.replica, 1);
  };
  using It = wire::Iteration;
  refuses("out of order", [](It& it) { it.number = 1; });
  refuses("out of order", [](It& it) { it.number = 3; });
  refuses("out of order", [](It& it) { it.number = 0; });
  refuses("was not held", [](It& it) { it.gone.push_back({0, 9, 9}); });
  refuses("was not held", [](It& it) { it.gone.push_back({1, 1, 0}); });
  refuses("gone twice", [](It& it) { it.gone.push_back(it.gone[0]); });
  refuses("there twice", [](It& it) { it.whole.push_back(it.whole[0]); });
  refuses("cannot be decoded", [](It& it) { it.whole.back().payload.pop_back(); });
  refuses("cannot be decoded", [](It& it) { it.whole.back().payload.clear(); });
  refuses("cannot be decoded", [](It& it) { it.whole.back().triangles += 1; });
  refuses("triangles", [](It& it) {
    for (wire::LeafWhole& w : it.whole) w.triangles = 0xffffffffu;
  });
  refuses("lattice", [](It& it) { it.whole.back().address.level = 11; });
  refuses("leaves", [](It& it) {
    for (int k = 0; k < 70'000; ++k) it.whole.push_back({.address = {0, k, 5}, .vertices = 0, .triangles = 0, .payload = {}});
  });
  const auto applied = f.scene.apply(good);
  ASSERT_TRUE(applied) << applied.error().message;
  EXPECT_EQ(f.scene.leaves().size(), 7u);
}

TEST(Scene, HeightIsThatOfTheTriangleUnderThePoint) {
  // A tilted plane y = 3 x - 2 z + 1000 over two leaves: every covered point has the plane's height.
  Scene scene;
  wire::Iteration it = iterationOf(1);
  const lattice::LeafAddress left{0, -1, 3}, right{0, 0, 3};
  for (const lattice::LeafAddress& address : {left, right}) {
    mesh::LeafMesh leaf{.address = address, .vertices = {}, .triangles = {}};
    for (std::int32_t x : {0, 4096, 8192})
      for (std::int32_t z : {0, 4096, 8192})
        leaf.vertices.push_back({x, z, static_cast<std::int32_t>(3 * (address.x() + x) - 2 * (address.z() + z) + 1000)});
    for (std::uint32_t a : {0u, 1u, 3u, 4u}) {
      leaf.triangles.push_back({a, a + 1, a + 3});
      leaf.triangles.push_back({a + 1, a + 4, a + 3});
    }
    mesh::canonicalize(leaf);
    it.whole.push_back(wholeOf(leaf));
  }
  const auto applied = scene.apply(it);
  ASSERT_TRUE(applied) << applied.error().message;
  Random random(3);
  for (int k = 0; k < 2000; ++k) {
    const lattice::Point p{between(random, -8192, 8192), between(random, left.z(), left.z() + 8192)};
    const auto height = scene.height(p);
    ASSERT_TRUE(height);
    EXPECT_NEAR(*height, static_cast<double>(3 * p.x - 2 * p.z + 1000) / 256, 1e-6);
  }
  EXPECT_FALSE(scene.height({-8193, left.z()}));
  EXPECT_FALSE(scene.height({0, left.z() - 1}));
  EXPECT_FALSE(scene.height({8193, left.z()}));
  EXPECT_FALSE(scene.height({lattice::kMaxPosition, -lattice::kMaxPosition}));
}

}  // namespace
}  // namespace ridgecast
