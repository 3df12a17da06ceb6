// Laws of canonical order and of the hash.
#include "common/mesh/leaf_mesh.h"

#include <gtest/gtest.h>

#include <numeric>

#include "tests/support/leaf_meshes.h"

namespace ridgecast {
namespace {

using mesh::LeafMesh;
using mesh::Triangle;
using support::between;
using support::Random;

// The same mesh with vertices and triangles in another order, triangles rotated, some vertices duplicated and some added unused.
LeafMesh disturbed(Random& random, const LeafMesh& leaf) {
  LeafMesh out = leaf;
  const std::size_t original = out.vertices.size();
  for (std::size_t k = 0; k < 3 && original > 0; ++k) {
    const auto which = static_cast<std::size_t>(between(random, 0, static_cast<std::int64_t>(original) - 1));
    out.vertices.push_back(out.vertices[which]);
    for (Triangle& t : out.triangles)
      for (std::uint32_t& v : t)
        if (v == which && between(random, 0, 1) == 0) v = static_cast<std::uint32_t>(out.vertices.size() - 1);
  }
  out.vertices.push_back({1'000'003, -5, 17});
  std::vector<std::uint32_t> place(out.vertices.size());
  std::iota(place.begin(), place.end(), 0u);
  std::shuffle(place.begin(), place.end(), random);
  std::vector<mesh::LocalVertex> vertices(out.vertices.size());
  for (std::size_t v = 0; v < vertices.size(); ++v) vertices[place[v]] = out.vertices[v];
  out.vertices = std::move(vertices);
  for (Triangle& t : out.triangles) {
    t = {place[t[0]], place[t[1]], place[t[2]]};
    std::rotate(t.begin(), t.begin() + between(random, 0, 2), t.end());
  }
  std::shuffle(out.triangles.begin(), out.triangles.end(), random);
  return out;
}

std::vector<LeafMesh> samples(Random& random) {
  std::vector<LeafMesh> all{{.address = {2, 1, -1}, .vertices = {}, .triangles = {}}};
  for (int points : {3, 5, 20, 200}) {
    all.push_back(support::randomTin(random, points));
    all.push_back(support::torn(random, support::randomTin(random, points), 0.4));
  }
  all.push_back(support::terrainLike(random, 8, 1));
  return all;
}

TEST(CanonicalOrder, DoesNotDependOnTheOrderBefore) {
  Random random(1);
  for (const LeafMesh& leaf : samples(random)) {
    EXPECT_TRUE(mesh::isCanonical(leaf));
    for (int round = 0; round < 10; ++round) {
      LeafMesh other = disturbed(random, leaf);
      EXPECT_FALSE(mesh::isCanonical(other));
      mesh::canonicalize(other);
      EXPECT_TRUE(other == leaf);
    }
  }
}

TEST(CanonicalOrder, IsIdempotent) {
  Random random(2);
  for (LeafMesh leaf : samples(random)) {
    const LeafMesh before = leaf;
    mesh::canonicalize(leaf);
    EXPECT_TRUE(leaf == before);
  }
}

TEST(CanonicalOrder, NoticesWhatIsNot) {
  const LeafMesh good{.address = {0, 0, 0}, .vertices = {{0, 0, 0}, {0, 4, 0}, {4, 0, 0}, {4, 4, 0}}, .triangles = {{0, 1, 2}, {1, 3, 2}}};
  EXPECT_TRUE(mesh::isCanonical(good));
  const auto with = [&](auto change) {
    LeafMesh leaf = good;
    change(leaf);
    return leaf;
  };
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.triangles[0] = {1, 2, 0}; })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { std::swap(l.triangles[0], l.triangles[1]); })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.triangles[1] = l.triangles[0]; })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.triangles[1][1] = 4; })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.triangles[1][1] = l.triangles[1][2]; })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.triangles.pop_back(); })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { l.vertices[3] = {4, 0, 9}; })));
  EXPECT_FALSE(mesh::isCanonical(with([](LeafMesh& l) { std::swap(l.vertices[0], l.vertices[3]); })));
}

TEST(Hash, DoesNotDependOnOrder) {
  Random random(3);
  for (const LeafMesh& leaf : samples(random))
    for (int round = 0; round < 5; ++round) EXPECT_EQ(mesh::hashLeaf(disturbed(random, leaf)), mesh::hashLeaf(leaf));
}

TEST(Hash, IsAFunctionOfWholePositionsNotOfTheLeaf) {
  // The same triangle, filed under another leaf with its local coordinates moved, has the same leaf hash (and another term).
  const LeafMesh here{.address = {0, 3, 4}, .vertices = {{0, 0, 1}, {0, 4, 2}, {4, 0, 3}}, .triangles = {{0, 1, 2}}};
  LeafMesh there{.address = {0, 4, 3}, .vertices = here.vertices, .triangles = here.triangles};
  for (mesh::LocalVertex& v : there.vertices) v = {v.x - 8192, v.z + 8192, v.y};
  EXPECT_EQ(mesh::hashLeaf(here), mesh::hashLeaf(there));
  EXPECT_NE(mesh::hashTerm(here.address, mesh::hashLeaf(here)), mesh::hashTerm(there.address, mesh::hashLeaf(there)));
}

TEST(Hash, ChangesWithEveryCoordinate) {
  Random random(4);
  for (const LeafMesh& leaf : samples(random)) {
    const std::uint64_t before = mesh::hashLeaf(leaf);
    for (std::size_t v = 0; v < std::min<std::size_t>(leaf.vertices.size(), 30); ++v)
      for (int which = 0; which < 3; ++which)
        for (std::int32_t by : {-1, 1, 4096}) {
          LeafMesh other = leaf;
          (which == 0 ? other.vertices[v].x : which == 1 ? other.vertices[v].z : other.vertices[v].y) += by;
          EXPECT_NE(mesh::hashLeaf(other), before);
        }
    if (leaf.triangles.empty()) continue;
    LeafMesh fewer = leaf;
    fewer.triangles.pop_back();
    EXPECT_NE(mesh::hashLeaf(fewer), before);
    LeafMesh mirrored = leaf;
    for (Triangle& t : mirrored.triangles) std::swap(t[1], t[2]);
    EXPECT_NE(mesh::hashLeaf(mirrored), before);
  }
}

TEST(Hash, EmptyLeavesCount) {
  EXPECT_EQ(mesh::hashLeaf({.address = {1, 2, 3}, .vertices = {}, .triangles = {}}), 0u);
  EXPECT_NE(mesh::hashTerm({1, 2, 3}, 0), 0u);
  EXPECT_NE(mesh::hashTerm({1, 2, 3}, 0), mesh::hashTerm({1, 3, 2}, 0));
}

// The formula as PROTOCOL.md states it, written out a second time.
std::uint64_t splitMix(std::uint64_t v) {
  std::uint64_t z = v + 0x9e3779b97f4a7c15ull;
  z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ z >> 27) * 0x94d049bb133111ebull;
  return z ^ z >> 31;
}
std::uint64_t vertexHash(std::int64_t x, std::int64_t z, std::int64_t y) {
  return splitMix(static_cast<std::uint64_t>(x) + splitMix(static_cast<std::uint64_t>(z) + splitMix(static_cast<std::uint64_t>(y))));
}

TEST(Hash, WorkedExampleOfTheProtocol) {
  const LeafMesh leaf{.address = {0, -1, 2}, .vertices = {{0, 0, -1}, {0, 256, 512}, {256, 0, 300}}, .triangles = {{0, 1, 2}}};
  const std::uint64_t v0 = vertexHash(-8192, 16384, -1), v1 = vertexHash(-8192, 16640, 512), v2 = vertexHash(-7936, 16384, 300);
  EXPECT_EQ(mesh::hashLeaf(leaf), splitMix(v0 + splitMix(v1 + splitMix(v2))));
  const std::uint64_t term = splitMix(mesh::hashLeaf(leaf) + splitMix(0 + splitMix(~0ull + splitMix(2))));
  EXPECT_EQ(mesh::hashTerm(leaf.address, mesh::hashLeaf(leaf)), term);
  // The numbers that PROTOCOL.md prints.
  EXPECT_EQ(v0, 0xab52e4168bc62efaull);
  EXPECT_EQ(v1, 0xb2deeff865d6f1b7ull);
  EXPECT_EQ(v2, 0xdb2d86c4496106d4ull);
  EXPECT_EQ(mesh::hashLeaf(leaf), 0x2350f977d9847e6bull);
  EXPECT_EQ(term, 0x831e8a487e12cd14ull);
}

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
