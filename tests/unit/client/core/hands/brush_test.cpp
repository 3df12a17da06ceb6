// What lies under a brush: on a slope, where everything is known.
#include "client/core/hands/brush.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/codec/codec.h"
#include "common/mesh/leaf_mesh.h"

namespace ridgecast::core {
namespace {

constexpr double kStep = lattice::kMetresPerStep;
using lattice::Vertex;

// One leaf, 32 m wide, which rises by half of x.
Scene slope() {
  const mesh::LeafMesh leaf{.address = {0, 0, 0},
                            .vertices = {{0, 0, 0}, {0, 8192, 0}, {8192, 0, 4096}, {8192, 8192, 4096}},
                            .triangles = {{0, 1, 2}, {1, 3, 2}}};
  wire::Iteration iteration;
  iteration.number = 1;
  iteration.whole = {{.address = leaf.address, .vertices = 4, .triangles = 2, .payload = codec::encodeLeaf(leaf)}};
  Scene scene;
  EXPECT_TRUE(scene.apply(iteration));
  return scene;
}

TEST(Brush, TouchesWhereTheRayMeetsTheMesh) {
  const Scene scene = slope();
  EXPECT_EQ(touched(scene, {4096, 4096, 100, 0, -3, 0, 1e6}), (Vertex{4096, 4096, 2048}));
  // From 8 m above the beginning of the slope, two ahead for each one down.
  EXPECT_EQ(touched(scene, {0, 1000, 8, 2, -1, 0, 1e6}), (Vertex{2048, 1000, 1024}));
  EXPECT_FALSE(touched(scene, {4096, 4096, 100, 0, 1, 0, 1e6})) << "the sky";
  EXPECT_FALSE(touched(scene, {4096, 4096, 100, 0, -1, 0, 50})) << "out of reach";
}

TEST(Brush, TheOutlineLiesOnTheMesh) {
  const Outline outline = outlineOf(slope(), {4096, 4096, 2048}, 512, {});
  EXPECT_TRUE(outline.line.empty());
  for (const Spot& spot : outline.around) {
    EXPECT_NEAR(std::hypot(spot.at.x - 4096, spot.at.z - 4096), 512, 1);
    EXPECT_NEAR(spot.y, static_cast<double>(spot.at.x) / 2 * kStep, 1e-9);
  }
  // Where there is none, at the height of the middle.
  for (const Spot& spot : outlineOf(slope(), {-4096, 4096, 77}, 512, {}).around) EXPECT_EQ(spot.y, 77 * kStep);
}

TEST(Brush, TheLineOfARoadGoesFromCornerToCornerAndEndsInTheMiddle) {
  const std::vector<Vertex> corners{{100, 100, 0}, {8000, 100, 0}, {8000, 8000, 0}};
  const std::vector<Spot> line = outlineOf(slope(), {100, 8000, 50}, 512, corners).line;
  std::size_t next = 0;
  for (std::size_t k = 0; k < line.size(); ++k) {
    if (next < corners.size() && line[k].at == lattice::Point{corners[next].x, corners[next].z}) ++next;
    if (k > 0) EXPECT_LE(std::hypot(line[k].at.x - line[k - 1].at.x, line[k].at.z - line[k - 1].at.z), 4 * 256 + 2);
    EXPECT_NEAR(line[k].y, static_cast<double>(line[k].at.x) / 2 * kStep, 1e-9);
  }
  EXPECT_EQ(next, corners.size());
  EXPECT_EQ(line.back().at, (lattice::Point{100, 8000}));
  // However far away, and a corner twice.
  EXPECT_EQ(outlineOf(slope(), {lattice::kMaxPosition, 0, 0}, 512, {{-lattice::kMaxPosition, 0, 0}}).line.size(), 257u);
  EXPECT_EQ(outlineOf(slope(), {5, 5, 0}, 512, {{5, 5, 0}, {5, 5, 0}}).line.size(), 3u);
}

}  // namespace
}  // namespace ridgecast::core
