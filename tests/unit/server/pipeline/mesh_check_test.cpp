// The independent checker itself: a sound mesh passes, and each kind of damage is seen as what it is.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "server/pipeline/pipeline.h"
#include "tests/support/mesh_check.h"

namespace ridgecast::testing_support {
namespace {

class Damage : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scheduling::Executor executor(2);
    const auto terrain = terrain::create("alpine", 3).value();
    pipeline::Pipeline p(terrain, pipeline::grant({}, {}), executor.makePool(2));
    camera::Camera camera;
    camera.pose.y = terrain->height({0, 0}) + 300;
    for (int n = 0; n < 4; ++n) p.iterate(camera);
    for (const auto& l : p.leaves()) sound_.push_back(p.extract(l.address));
  }
  void SetUp() override {
    ASSERT_TRUE(checkMesh(sound_).clean());
    leaves_ = sound_;
    busy_ = static_cast<std::size_t>(
        std::max_element(leaves_.begin(), leaves_.end(), [](auto& a, auto& b) { return a.triangles.size() < b.triangles.size(); }) -
        leaves_.begin());
  }
  mesh::LeafMesh& busy() { return leaves_[busy_]; }

  static std::vector<mesh::LeafMesh> sound_;
  std::vector<mesh::LeafMesh> leaves_;
  std::size_t busy_ = 0;
};
std::vector<mesh::LeafMesh> Damage::sound_;

TEST_F(Damage, AMissingTriangleIsACrack) {
  busy().triangles.erase(busy().triangles.begin() + 7);
  EXPECT_EQ(checkMesh(leaves_).cracks, 1u);
}

TEST_F(Damage, AMissingLeafIsNoCrackButAnEmptyOneIs) {
  auto without = leaves_;
  without[busy_].triangles.clear();
  EXPECT_GT(checkMesh(without).cracks, 0u);
}

TEST_F(Damage, ADuplicateIsOverused) {
  busy().triangles.push_back(busy().triangles[3]);
  EXPECT_GT(checkMesh(leaves_).overused, 0u);
}

TEST_F(Damage, ATurnedTriangleIsClockwise) {
  std::swap(busy().triangles[5][0], busy().triangles[5][1]);
  EXPECT_EQ(checkMesh(leaves_).clockwise, 1u);
}

TEST_F(Damage, ATriangleInAnotherLeafIsMisfiled) {
  auto& other = leaves_[busy_ == 0 ? 1 : 0];
  const auto t = busy().triangles[2];
  mesh::Triangle moved{};
  for (int k = 0; k < 3; ++k) {
    const auto v = busy().vertices[t[k]];
    other.vertices.push_back({static_cast<std::int32_t>(v.x + busy().address.x() - other.address.x()),
                              static_cast<std::int32_t>(v.z + busy().address.z() - other.address.z()), v.y});
    moved[k] = static_cast<std::uint32_t>(other.vertices.size() - 1);
  }
  busy().triangles.erase(busy().triangles.begin() + 2);
  other.triangles.push_back(moved);
  const auto report = checkMesh(leaves_);
  EXPECT_EQ(report.misfiled, 1u);
  EXPECT_EQ(report.cracks, 0u);
}

TEST_F(Damage, ALiftedCopyOfAVertexHasTwoHeights) {
  auto v = busy().vertices[busy().triangles[0][0]];
  ++v.y;
  busy().vertices.push_back(v);
  EXPECT_EQ(checkMesh(leaves_).heights, 1u);
}

TEST_F(Damage, AFlippedDiagonalIsNotDelaunay) {
  auto& leaf = busy();
  for (std::size_t a = 0; a < leaf.triangles.size(); ++a)
    for (std::size_t b = a + 1; b < leaf.triangles.size(); ++b)
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
          auto &s = leaf.triangles[a], &t = leaf.triangles[b];
          if (s[i] != t[(j + 1) % 3] || s[(i + 1) % 3] != t[j]) continue;
          const std::uint32_t u = s[i], v = s[(i + 1) % 3], p = s[(i + 2) % 3], q = t[(j + 2) % 3];
          auto flipped = leaves_;
          flipped[busy_].triangles[a] = {p, u, q};
          flipped[busy_].triangles[b] = {q, v, p};
          const auto report = checkMesh(flipped);
          if (report.clockwise) continue;  // not a convex quadrilateral
          EXPECT_GT(report.notDelaunay + report.notCanonical, 0u);
          return;
        }
  FAIL() << "no pair to flip";
}

TEST_F(Damage, AVertexMovedOnOneSideOfABorderIsACrack) {
  std::set<std::pair<lattice::Step, lattice::Step>> elsewhere;
  for (const auto& leaf : leaves_)
    for (const auto& v : leaf.vertices)
      if (&leaf != &busy()) elsewhere.insert({leaf.address.x() + v.x, leaf.address.z() + v.z});
  const auto shared = std::find_if(busy().vertices.begin(), busy().vertices.end(), [&](const auto& v) {
    return elsewhere.count({busy().address.x() + v.x, busy().address.z() + v.z}) > 0;
  });
  ASSERT_NE(shared, busy().vertices.end());
  shared->x -= 3;
  const auto report = checkMesh(leaves_);
  EXPECT_GT(report.cracks + report.overused + report.clockwise, 0u);
}

}  // namespace
}  // namespace ridgecast::testing_support
