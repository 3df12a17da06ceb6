#include <gtest/gtest.h>

#include <map>

#include "common/mesh/leaf_mesh.h"
#include "server/encoding/bases.h"
#include "tests/support/leaf_meshes.h"

namespace ridgecast::encoding {
namespace {

using lattice::LeafAddress;

TEST(Bases, KeepWhatTheBudgetHolds) {
  support::Random random(1);
  Bases bases(200'000);
  std::map<LeafAddress, mesh::LeafMesh> model;
  mesh::LeafMesh found;  // of which nothing may be left over
  for (int k = 0; k < 2000; ++k) {
    mesh::LeafMesh leaf = support::terrainLike(random, static_cast<int>(support::between(random, 1, 14)), 0);
    leaf.address = {0, support::between(random, 0, 40), 0};
    if (k % 5 == 0) {
      bases.erase(leaf.address);
      model.erase(leaf.address);
    } else {
      bases.put(leaf);
      model[leaf.address] = leaf;
    }
    ASSERT_LE(bases.bytes(), bases.budget());
    if (bases.find(leaf.address, found)) {
      ASSERT_TRUE(model.contains(leaf.address) && found == leaf);
      EXPECT_EQ(bases.triangles(leaf.address), leaf.triangles.size());
    }
  }
  std::size_t kept = 0;
  for (const auto& [address, leaf] : model)
    if (bases.find(address, found)) {
      EXPECT_TRUE(found == leaf);  // never an older version
      ++kept;
    }
  EXPECT_GT(kept, 10u);
  for (const auto& [address, leaf] : model) bases.erase(address);
  EXPECT_EQ(bases.bytes(), 0u);
}

TEST(Bases, HoldLargeLeavesToo) {
  support::Random random(2);
  Bases bases(100u << 20);
  const mesh::LeafMesh leaf = support::terrainLike(random, 300, 3);  // more than 65,536 vertices
  ASSERT_GT(leaf.vertices.size(), 65'536u);
  bases.put(leaf);
  mesh::LeafMesh found;
  EXPECT_TRUE(bases.find(leaf.address, found) && found == leaf);
}

}  // namespace
}  // namespace ridgecast::encoding
