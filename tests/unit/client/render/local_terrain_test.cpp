// How a client draws worlds whose terrain it has, receives, refuses or cannot compile. Needs EGL; says so and skips where there is none.
#include "client/render/local_terrain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "client/render/context.h"
#include "client/render/renderer.h"
#include "tests/unit/common/terrain/points.h"

namespace ridgecast::render {
namespace {

using testing::HasSubstr;

class LocalTerrain : public testing::Test {
 protected:
  void SetUp() override {
    auto made = HeadlessContext::create();
    if (!made) GTEST_SKIP() << "no OpenGL here: " << made.error().message;
    context_ = std::move(*made);
  }
  static wire::World worldOf(const terrain::Terrain& t) {
    wire::World world;
    world.terrainName = t.name();
    world.terrainSource = t.source();
    world.seed = t.seed();
    world.contentHash = terrain::contentHash(t);
    return world;
  }
  std::unique_ptr<HeadlessContext> context_;
};

TEST_F(LocalTerrain, aTerrainOfItsOwnNeedsNothingReceived) {
  const auto own = terrain::create("alpine", 9).value();
  wire::World world = worldOf(*own);
  world.terrainSource = "what a server could send instead";
  for (const bool remote : {true, false}) {
    const Drawing d = drawingOf(world, remote);
    EXPECT_FALSE(d.text.neutral);
    EXPECT_EQ(d.text.source, own->source());
    ASSERT_TRUE(d.terrain);
    EXPECT_EQ(d.terrain->height({1000, 2000}), own->height({1000, 2000}));
  }
}

TEST_F(LocalTerrain, aTextReceivedGivesTheServersHeights) {
  const auto original = terrain::create("canyon", 9).value();
  wire::World world = worldOf(*original);
  world.terrainName = "elsewhere";
  const Drawing d = drawingOf(world, true);
  ASSERT_TRUE(d.terrain) << d.why;
  EXPECT_TRUE(d.why.empty());
  const bool exact = contextDescription().find("llvmpipe") != std::string::npos;
  for (const double distance : terrain::kDistances) {
    for (const std::size_t count : {1u, 63u, 4097u}) {
      const terrain::Points p = terrain::pointsAt(distance, count);
      std::vector<float> a(count), b(count);
      original->heights(p.x, p.z, a);
      d.terrain->heights(p.x, p.z, b);
      std::size_t different = 0;
      float worst = 0;
      for (std::size_t i = 0; i < count; ++i) {
        different += std::bit_cast<std::uint32_t>(a[i]) != std::bit_cast<std::uint32_t>(b[i]);
        worst = std::max(worst, std::abs(a[i] - b[i]));
      }
      EXPECT_LT(worst, 0.05f);
      if (exact) {
        EXPECT_EQ(different, 0u) << count << " at " << distance;
      }
    }
  }
}

TEST_F(LocalTerrain, whatIsRefusedPrivateOrBrokenIsDrawnNeutrally) {
  wire::World world = worldOf(*terrain::create("canyon", 9).value());
  world.terrainName = "elsewhere";
  EXPECT_THAT(drawingOf(world, false).why, HasSubstr("--no-remote-shaders"));
  wire::World secret = world;
  secret.terrainSource.clear();
  EXPECT_THAT(drawingOf(secret, true).why, HasSubstr("keeps its terrain's text to itself"));
  wire::World broken = world;
  broken.terrainSource = "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n  return nonsense;\n}\n";
  EXPECT_THAT(drawingOf(broken, true).why, HasSubstr("2"));
  // Heights compile, colours do not.
  broken.terrainSource = "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 1.0; }\n";
  for (const wire::World& w : {secret, broken}) {
    const Drawing d = drawingOf(w, true);
    EXPECT_TRUE(d.text.neutral);
    EXPECT_FALSE(d.terrain);
    EXPECT_THAT(d.why, HasSubstr("neutral"));
  }
}

// A roof whose faces slope 30 degrees towards and away from the sun's side: the neutral picture must tell them apart, from the mesh alone.
TEST_F(LocalTerrain, theNeutralPictureShowsTheShapeOfTheMesh) {
  auto renderer = Renderer::create({{}, 1, true});
  ASSERT_TRUE(renderer) << renderer.error().message;
  auto leaf = std::make_shared<mesh::LeafMesh>();
  leaf->address = {2, 0, -1};  // 128 m
  const std::int32_t side = 128 * 256, ridge = side / 2, low = 100 * 256, high = low + 37 * 256;
  leaf->vertices = {{0, 0, low}, {0, side, low}, {ridge, 0, high}, {ridge, side, high}, {side, 0, low}, {side, side, low}};
  leaf->triangles = {{0, 1, 2}, {1, 3, 2}, {2, 3, 4}, {3, 5, 4}};
  core::HeldLeaf held;
  held.mesh = leaf;
  held.low = {0, 0, low};
  held.high = {side, side, high};
  held.version = 1;
  View view;
  view.camera.pose.x = ridge;
  view.camera.pose.z = -side / 2;
  view.camera.pose.y = 300;
  view.camera.pose.pitch = -1.55;
  view.camera.projection.width = view.camera.projection.height = 64;
  view.horizon = 32000;
  const auto drawn = renderer->drawMesh(std::map<lattice::LeafAddress, core::HeldLeaf>{{leaf->address, held}}, view);
  ASSERT_TRUE(drawn) << drawn.error().message;
  const auto pixel = [&](std::size_t x, std::size_t y, std::size_t c) {
    return static_cast<int>(drawn->picture.rgb[3 * (y * 64 + x) + c]);
  };
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_GT(pixel(40, 32, c), pixel(24, 32, c) + 20) << "the eastern face looks towards the sun";
    EXPECT_NEAR(pixel(38, 30, c), pixel(40, 34, c), 6) << "one face, one shade";
  }
  // There is no ground to march.
  const auto marched = renderer->drawMarch(view);
  ASSERT_TRUE(marched);
  EXPECT_EQ(std::count(marched->picture.terrain.begin(), marched->picture.terrain.end(), 255), 0);
}

}  // namespace
}  // namespace ridgecast::render
