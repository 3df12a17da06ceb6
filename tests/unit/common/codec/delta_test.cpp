// Law: decoding a delta over its base is bit for bit the leaf it was made for, whatever changed; and bytes that nobody encoded are an
// error or a sound leaf.
#include "common/codec/delta.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "common/mesh/leaf_mesh.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast {
namespace {

using support::between;
using support::Random;
using Bytes = std::vector<std::uint8_t>;

Bytes encode(const mesh::LeafMesh& base, const mesh::LeafMesh& target) {
  const auto payload = codec::encodeDelta(base, target, mesh::hashLeaf(target));
  EXPECT_TRUE(payload);
  return payload.value_or(Bytes{});
}

void expectMakes(const mesh::LeafMesh& base, const mesh::LeafMesh& target) {
  const auto payload = codec::encodeDelta(base, target, mesh::hashLeaf(target));
  if (!payload) return;  // to be sent whole; counted by the caller
  const auto counts = codec::deltaCounts(*payload, base.triangles.size());
  ASSERT_TRUE(counts);
  EXPECT_EQ(base.triangles.size() - counts->removed + counts->added, target.triangles.size());
  const auto changed = codec::decodeDelta(*payload, base, mesh::hashLeaf(base));
  ASSERT_TRUE(changed) << changed.error().message << " (" << base.triangles.size() << " -> " << target.triangles.size() << " triangles)";
  EXPECT_TRUE(changed->leaf == target);
  EXPECT_EQ(changed->hash, mesh::hashLeaf(target));
}

// Two triangulations that share most of their points.
std::pair<mesh::LeafMesh, mesh::LeafMesh> relatives(Random& random, int points, int more) {
  const mesh::LeafMesh all = support::randomTin(random, points + more);
  std::vector<mesh::LocalVertex> some, others;
  for (const mesh::LocalVertex& v : all.vertices) {
    const bool inBoth = between(random, 1, points + more) <= points;
    if (inBoth || between(random, 0, 1) == 0) some.push_back(v);
    if (inBoth || between(random, 0, 1) == 0) others.push_back(v);
  }
  return {support::sweep(all.address, some), support::sweep(all.address, others)};
}

TEST(Delta, OfNothingIsEmpty) {
  Random random(1);
  const mesh::LeafMesh leaf = support::terrainLike(random, 5, 1), empty{.address = leaf.address, .vertices = {}, .triangles = {}};
  EXPECT_TRUE(encode(leaf, leaf).empty());
  EXPECT_TRUE(encode(empty, empty).empty());
  expectMakes(leaf, leaf);
  expectMakes(empty, empty);
}

TEST(Delta, MakesAnyLeafOfAnyOther) {
  Random random(2);
  for (int points : {3, 4, 6, 10, 30, 100, 400})
    for (int k = 0; k < 60; ++k) {
      const auto [base, target] = relatives(random, points, 1 + k % 20);
      expectMakes(base, target);
      expectMakes(target, base);
    }
}

TEST(Delta, MakesLeavesWithHolesIslandsAndPinches) {
  Random random(3);
  for (double share : {0.02, 0.2, 0.5, 0.9})
    for (int n : {1, 2, 5, 12})
      for (int k = 0; k < 20; ++k) {
        const mesh::LeafMesh whole = support::terrainLike(random, n, k % 9);
        const mesh::LeafMesh a = support::torn(random, whole, share), b = support::torn(random, whole, share);
        expectMakes(a, b);
        expectMakes(whole, a);
        expectMakes(a, whole);
        mesh::LeafMesh other = support::terrainLike(random, n, k % 9);
        other.address = whole.address;
        expectMakes(whole, other);  // nothing in common
      }
}

// Found by the fuzzer: where triangles overlap, two may lie on the same side of an edge, and one of them was coded twice.
TEST(Delta, MakesSoupsOrRefusesThem) {
  Random random(5);
  int made = 0, refused = 0;
  for (int k = 0; k < 20000; ++k) {
    const mesh::LeafMesh base = support::randomTin(random, 6);
    mesh::LeafMesh target{.address = base.address, .vertices = base.vertices, .triangles = {}};
    const auto count = static_cast<std::int64_t>(target.vertices.size());
    if (count < 3) continue;
    for (auto n = between(random, 1, 8); n > 0; --n) {
      std::array<std::uint32_t, 3> t;
      for (auto& v : t) v = static_cast<std::uint32_t>(between(random, 0, count - 1));
      const auto& p = target.vertices;
      if (support::doubledArea(p[t[0]], p[t[1]], p[t[2]]) <= 0) continue;
      target.triangles.push_back(t);
    }
    mesh::canonicalize(target);
    target.triangles.erase(std::unique(target.triangles.begin(), target.triangles.end()), target.triangles.end());
    (codec::encodeDelta(base, target, mesh::hashLeaf(target)) ? made : refused)++;
    expectMakes(base, target);
  }
  EXPECT_GT(made, 100);
  EXPECT_GT(refused, 3);
}

TEST(Delta, MovesHeightsAlone) {
  Random random(4);
  const mesh::LeafMesh base = support::terrainLike(random, 8, 3);
  mesh::LeafMesh target = base;
  for (std::size_t v = 0; v < target.vertices.size(); v += 7) target.vertices[v].y += 4096;
  expectMakes(base, target);
}

TEST(Delta, AFewNewPointsCostAFewBytes) {
  Random random(5);
  const mesh::LeafMesh base = support::terrainLike(random, 45, 0);
  mesh::LeafMesh target = base;
  for (int k = 0; k < 8; ++k) {  // a point into the middle of a triangle: one goes, three come
    const std::size_t t = static_cast<std::size_t>(between(random, 0, static_cast<std::int64_t>(target.triangles.size()) - 1));
    const mesh::Triangle old = target.triangles[t];
    const auto &a = target.vertices[old[0]], &b = target.vertices[old[1]], &c = target.vertices[old[2]];
    const auto v = static_cast<std::uint32_t>(target.vertices.size());
    target.vertices.push_back({(a.x + b.x + c.x) / 3, (a.z + b.z + c.z) / 3, (a.y + b.y + c.y) / 3});
    target.triangles[t] = {old[0], old[1], v};
    target.triangles.push_back({old[1], old[2], v});
    target.triangles.push_back({old[2], old[0], v});
  }
  mesh::canonicalize(target);
  expectMakes(base, target);
  EXPECT_LT(encode(base, target).size(), 80u);
}

// The example of PROTOCOL.md: a point into a square of two triangles, on its diagonal.
mesh::LeafMesh square(bool split) {
  mesh::LeafMesh leaf{
      .address = {0, 0, 0}, .vertices = {{0, 0, 0}, {0, 512, 0}, {512, 0, 0}, {512, 512, 0}}, .triangles = {{0, 1, 2}, {1, 3, 2}}};
  if (split) {
    leaf.vertices.push_back({256, 256, 100});
    leaf.triangles = {{0, 1, 4}, {1, 3, 4}, {3, 2, 4}, {2, 0, 4}};
  }
  mesh::canonicalize(leaf);
  return leaf;
}

TEST(Delta, WorkedExampleOfTheProtocol) {
  const mesh::LeafMesh base = square(false), target = square(true);
  expectMakes(base, target);
  const Bytes expected{0x20, 2, 4, 1, 0xbe, 0x41, 0x9f, 0xb5, 0xb5, 0x4c, 0xf9, 0x37, 0xa2};
  EXPECT_EQ(encode(base, target), expected);
}

// ---- what is refused ----

struct Sample {
  mesh::LeafMesh base, target;
  Bytes payload;
};
std::vector<Sample> samples() {
  Random random(6);
  std::vector<Sample> all;
  const auto add = [&](mesh::LeafMesh base, mesh::LeafMesh target) {
    Bytes payload = encode(base, target);
    if (!payload.empty()) all.push_back({std::move(base), std::move(target), std::move(payload)});
  };
  add(square(false), square(true));
  add(square(true), square(false));
  for (int points : {5, 20, 80, 200}) {
    auto [base, target] = relatives(random, points, 6);
    add(base, target);
  }
  const mesh::LeafMesh whole = support::terrainLike(random, 8, 1);
  add(whole, support::torn(random, whole, 0.2));
  add(support::torn(random, whole, 0.2), whole);
  return all;
}

void expectSane(const Outcome<codec::Changed>& changed, const mesh::LeafMesh& base) {
  if (!changed) {
    EXPECT_FALSE(changed.error().message.empty());
    return;
  }
  EXPECT_TRUE(mesh::isCanonical(changed->leaf));
  EXPECT_EQ(changed->leaf.address, base.address);
  EXPECT_EQ(changed->hash, mesh::hashLeaf(changed->leaf));
  for (const mesh::Triangle& t : changed->leaf.triangles)
    EXPECT_GT(support::doubledArea(changed->leaf.vertices[t[0]], changed->leaf.vertices[t[1]], changed->leaf.vertices[t[2]]), 0);
  for (const mesh::LocalVertex& v : changed->leaf.vertices)
    EXPECT_LE(std::max({std::abs(v.x), std::abs(v.z), std::abs(v.y)}), codec::kMaxOffset);
}

TEST(HostileDelta, EveryTruncatedPrefixIsRefused) {
  for (const Sample& s : samples())
    for (std::size_t length = 1; length < s.payload.size(); ++length) {
      const Bytes prefix(s.payload.begin(), s.payload.begin() + static_cast<std::ptrdiff_t>(length));  // a fresh allocation
      EXPECT_FALSE(codec::decodeDelta(prefix, s.base, mesh::hashLeaf(s.base))) << length << " of " << s.payload.size();
    }
}

TEST(HostileDelta, BytesBehindTheEndAreRefused) {
  for (const Sample& s : samples())
    for (std::uint8_t more : {0, 1, 255}) {
      Bytes longer = s.payload;
      longer.push_back(more);
      EXPECT_FALSE(codec::decodeDelta(longer, s.base, mesh::hashLeaf(s.base)));
    }
}

TEST(HostileDelta, FlippedBitsAndNoiseNeverYieldAnUnsoundLeaf) {
  Random random(7);
  for (const Sample& s : samples()) {
    for (std::size_t bit = 0; bit < 8 * s.payload.size(); ++bit) {
      Bytes changed = s.payload;
      changed[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
      expectSane(codec::decodeDelta(changed, s.base, mesh::hashLeaf(s.base)), s.base);
    }
    for (int k = 0; k < 200; ++k) {
      Bytes noise{0x20, static_cast<std::uint8_t>(random() % 8), static_cast<std::uint8_t>(random() % 40),
                  static_cast<std::uint8_t>(random() % 9)};
      for (int n = 0; n < 40; ++n) noise.push_back(static_cast<std::uint8_t>(random()));
      expectSane(codec::decodeDelta(noise, s.base, mesh::hashLeaf(s.base)), s.base);
    }
  }
}

TEST(HostileDelta, AnotherBaseIsRefused) {
  for (const Sample& s : samples()) EXPECT_FALSE(codec::decodeDelta(s.payload, s.target, mesh::hashLeaf(s.target)));
}

TEST(HostileDelta, CountsAreCheckedBeforeAnythingIsAllocated) {
  const mesh::LeafMesh base = square(false);
  const auto refused = [&](Bytes head, const char* why) {
    head.insert(head.end(), {0, 0, 0, 0, 1, 2, 3});
    const auto counts = codec::deltaCounts(head, base.triangles.size());
    ASSERT_FALSE(counts) << why;
    EXPECT_NE(counts.error().message.find(why), std::string::npos) << counts.error().message;
    EXPECT_FALSE(codec::decodeDelta(head, base, 0));
  };
  refused({0x21, 0, 1, 1}, "form");
  refused({0x20, 3, 1, 1}, "more triangles go");
  refused({0x20, 0, 0xff, 0xff, 0x7f, 1}, "more than 1048576");
  refused({0x20, 0, 0x80, 0x10, 1}, "contradict");
  refused({0x20, 0, 1, 4}, "contradict");
}

// ---- gathering ----

TEST(Gather, ChildrenShareOutTheirParentAndMakeItAgain) {
  Random random(8);
  for (int k = 0; k < 30; ++k) {
    mesh::LeafMesh parent = support::terrainLike(random, 9, 3);
    // Only what lies inside belongs to it.
    std::erase_if(parent.triangles, [&](const mesh::Triangle& t) {
      std::int64_t x = 3 * parent.address.x(), z = 3 * parent.address.z();
      for (std::uint32_t v : t) x += parent.vertices[v].x, z += parent.vertices[v].z;
      return !parent.address.containsCentroid(x, z);
    });
    mesh::canonicalize(parent);
    std::vector<mesh::LeafMesh> children;
    std::size_t triangles = 0;
    const mesh::LeafMesh* source = &parent;
    for (int q = 0; q < 4; ++q) {
      children.push_back(mesh::gather(parent.address.child(q), {&source, 1}));
      EXPECT_TRUE(mesh::isCanonical(children.back()));
      triangles += children.back().triangles.size();
    }
    EXPECT_EQ(triangles, parent.triangles.size());
    std::vector<const mesh::LeafMesh*> all;
    for (const auto& c : children) all.push_back(&c);
    EXPECT_TRUE(mesh::gather(parent.address, all) == parent);
  }
}

}  // namespace
}  // namespace ridgecast
