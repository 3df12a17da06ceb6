// Meshes that change without a jump: which two are shown when, and what lies between them. The drawing test needs EGL and skips without.
#include "client/render/morph.h"

#include <gtest/gtest.h>

#include "client/evaluation/popping.h"
#include "client/evaluation/ssim.h"
#include "client/render/context.h"
#include "client/render/renderer.h"

namespace ridgecast::render {
namespace {

constexpr lattice::LeafAddress kAddress{4, 0, -1};  // 512 m

Morph::Leaves flat(std::int32_t metres, std::uint64_t version) {
  auto leaf = std::make_shared<mesh::LeafMesh>();
  leaf->address = kAddress;
  const auto side = static_cast<std::int32_t>(kAddress.side()), y = metres * 256;
  leaf->vertices = {{0, 0, y}, {0, side, y}, {side, 0, y}, {side, side, y}};
  leaf->triangles = {{0, 1, 2}, {1, 3, 2}};
  core::HeldLeaf held;
  held.mesh = leaf;
  held.low = leaf->vertices.front();
  held.high = leaf->vertices.back();
  held.version = version;
  return {{kAddress, held}};
}

TEST(Morph, showsTheFirstMeshAtOnceAndLaterOnesOneAfterTheOther) {
  Morph morph;
  morph.advance(flat(1, 1), 1, 0.0, true);
  EXPECT_FALSE(morph.active());
  EXPECT_EQ(morph.share(0.0), 1.0f);
  morph.advance(flat(2, 2), 2, 1.0, true);
  ASSERT_TRUE(morph.active());
  EXPECT_EQ(morph.from().at(kAddress).version, 1u);
  EXPECT_EQ(morph.to().at(kAddress).version, 2u);
  EXPECT_EQ(morph.share(1.0), 0.0f);
  morph.advance(flat(3, 3), 3, 1.1, true);  // comes in between: waits
  morph.advance(flat(4, 4), 4, 1.2, true);
  EXPECT_EQ(morph.to().at(kAddress).version, 2u);
  EXPECT_NEAR(morph.share(1.2), 0.2 / kMorphSeconds, 1e-6);
  morph.advance(flat(4, 4), 4, 1.0 + kMorphSeconds + 0.001, true);
  EXPECT_EQ(morph.from().at(kAddress).version, 2u) << "where it had come to";
  EXPECT_EQ(morph.to().at(kAddress).version, 4u) << "and straight to the newest";
  morph.advance(flat(4, 4), 4, 2.0, true);
  EXPECT_FALSE(morph.active());
  morph.advance(flat(5, 5), 5, 2.1, false);
  EXPECT_FALSE(morph.active()) << "at once";
  EXPECT_EQ(morph.to().at(kAddress).version, 5u);
}

TEST(MorphDrawing, theGroundMovesFromTheOneToTheOther) {
  auto context = HeadlessContext::create();
  if (!context) GTEST_SKIP() << "no OpenGL here: " << context.error().message;
  auto renderer = Renderer::create({R"(
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 0.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  vec2 square = floor(fraction * 512.0);
  return vec3(0.2 + 0.6 * mod(square.x + square.y, 2.0));
}
)",
                                    1});
  ASSERT_TRUE(renderer) << renderer.error().message;
  View view;
  view.camera.pose.x = view.camera.pose.z = 0;
  view.camera.pose.x = 256 * 256;
  view.camera.pose.z = -20 * 256;
  view.camera.pose.y = 200;
  view.camera.pose.pitch = -0.5;
  view.camera.projection.width = 160;
  view.camera.projection.height = 90;
  view.horizon = 32'000;
  const auto low = flat(100, 1), high = flat(104, 2), middle = flat(102, 3);
  const auto first = renderer->drawMesh(low, view), last = renderer->drawMesh(high, view), between = renderer->drawMesh(middle, view);
  ASSERT_TRUE(first && last && between);
  EXPECT_EQ(renderer->drawMorph(low, high, 0, view)->picture.rgb, first->picture.rgb);
  EXPECT_EQ(renderer->drawMorph(low, high, 1, view)->picture.rgb, last->picture.rgb);
  EXPECT_GT(evaluation::similarity(renderer->drawMorph(low, high, 0.5f, view)->picture, between->picture).mean, 0.97);
  EXPECT_LT(evaluation::similarity(first->picture, last->picture).mean, 0.9);

  const auto popping = evaluation::measurePopping(*renderer, view, {low, high, low});
  ASSERT_TRUE(popping);
  EXPECT_GT(popping->off, 0.1);
  EXPECT_LE(popping->on, popping->off / 3);
  EXPECT_GT(popping->on, 0);
}

}  // namespace
}  // namespace ridgecast::render
