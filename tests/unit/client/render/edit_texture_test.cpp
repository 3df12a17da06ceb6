// Edited ground from the graphics driver: the processor's bits, through the squares that a client holds. Needs EGL and skips, saying why,
// where there is none.
#include "client/render/edit_texture.h"

#include <gtest/gtest.h>

#include <bit>
#include <memory>
#include <random>

#include "client/render/context.h"
#include "client/render/gpu_terrain.h"
#include "client/render/renderer.h"
#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "tests/support/random_edits.h"

namespace ridgecast::render {
namespace {

using lattice::Point;
using lattice::Step;
using testing_support::m;

class EditTextures : public testing::Test {
 protected:
  void SetUp() override {
    auto made = HeadlessContext::create();
    if (!made) GTEST_SKIP() << "no OpenGL here: " << made.error().message;
    context_ = std::move(*made);
  }
  // What a client holds of a layer, all of it.
  static void hold(core::HeldEdits& held, const edits::History& history, Point at) {
    held.moveTo(at);
    held.know(history.last());
    while (!held.complete()) {
      const auto [find, want] = held.take();
      if (find) {
        const lattice::Area all{-m(1e13), -m(1e13), m(1e13), m(1e13)};
        ASSERT_TRUE(held.put(wire::FoundEdits{history.last(), {all}, edits::squaresAround(*history.layer(), at, find->radius, 4096)}));
      }
      wire::Squares squares{history.last(), {}};
      for (const auto a : want.squares) {
        auto bytes = edits::encode(edits::squareOf(*history.layer(), a));
        squares.squares.push_back({a, std::move(bytes.rises), std::move(bytes.materials)});
      }
      ASSERT_TRUE(held.put(squares));
    }
  }
  static std::vector<Point> placesAround(Point middle, std::size_t count, double reach) {
    std::mt19937_64 random(count);
    std::vector<Point> out;
    for (std::size_t k = 0; k < count; ++k)
      out.push_back({middle.x + static_cast<Step>(random() % static_cast<std::uint64_t>(m(2 * reach))) - m(reach),
                     middle.z + static_cast<Step>(random() % static_cast<std::uint64_t>(m(2 * reach))) - m(reach)});
    return out;
  }
  static std::vector<float> heightsOf(const terrain::Terrain& terrain, const std::vector<Point>& places) {
    std::vector<Step> x, z;
    for (const Point p : places) x.push_back(p.x), z.push_back(p.z);
    std::vector<float> out(places.size());
    terrain.heights(x, z, out);
    return out;
  }
  static std::size_t differences(const std::vector<float>& a, const std::vector<float>& b) {
    std::size_t out = 0;
    for (std::size_t k = 0; k < a.size(); ++k) out += std::bit_cast<std::uint32_t>(a[k]) != std::bit_cast<std::uint32_t>(b[k]);
    return out;
  }
  std::unique_ptr<HeadlessContext> context_;
};

// Bit for bit with llvmpipe; drivers that fuse multiplication and addition may differ.
TEST_F(EditTextures, GiveTheProcessorsHeights) {
  const bool exact = contextDescription().find("llvmpipe") != std::string::npos;
  const struct {
    const char* terrain;
    double distance;
    int operations;
  } kCases[] = {{"alpine", 0, 1000}, {"alpine", 1e9, 1000}, {"canyon", 4e12, 200}};
  for (const auto& c : kCases) {
    const Point middle{m(c.distance), -m(c.distance)};
    const auto base = terrain::create(c.terrain, 1).value();
    edits::History history(base);
    std::mt19937_64 random(static_cast<std::uint64_t>(c.operations));
    while (history.last() < static_cast<std::uint64_t>(c.operations)) {
      auto operation = testing_support::randomOperation(random, middle);
      if (history.last() % 100 == 99) operation = {edits::Undo{1 + random() % history.last()}, 0};
      const auto prepared = history.prepare(std::move(operation));
      ASSERT_TRUE(!prepared || history.add(*prepared));
    }
    core::HeldEdits held(32'000);
    EditTexture texture;
    const auto gpu = gpuTerrain(c.terrain, {std::string(base->source()), 1}, nullptr, &texture);
    ASSERT_TRUE(gpu) << gpu.error().message;
    auto places = placesAround(middle, 100'000, 150);
    for (const Point p : placesAround(middle, 5'000, 40'000)) places.push_back(p);
    for (const Point p : placesAround({middle.x + m(1e7), middle.z}, 1000, 10)) places.push_back(p);
    EXPECT_EQ(differences(heightsOf(**gpu, places), heightsOf(*base, places)), 0u) << "before any edit";
    hold(held, history, middle);
    while (!texture.update(held, middle)) {
    }
    const auto right = heightsOf(edits::EditedTerrain(base, history.layer()), places);
    const std::size_t different = differences(heightsOf(**gpu, places), right);
    EXPECT_GT(differences(right, heightsOf(*base, places)), 30'000u);
    EXPECT_TRUE(!exact || different == 0) << different << " differ: " << c.terrain << " at " << c.distance;
    // From another place nearby, whose table begins elsewhere.
    texture.update(held, {middle.x + m(9000), middle.z - m(9000)});
    EXPECT_TRUE(!exact || differences(heightsOf(**gpu, places), right) == 0u);
  }
}

TEST_F(EditTextures, OfWhatIsUndoneGiveTheTerrainsOwn) {
  const auto base = terrain::create("alpine", 1).value();
  edits::History history(base);
  std::mt19937_64 random(4);
  while (history.last() < 60) {
    const auto prepared = history.prepare(testing_support::randomOperation(random, {0, 0}));
    ASSERT_TRUE(!prepared || history.add(*prepared));
  }
  core::HeldEdits held(32'000);
  EditTexture texture;
  const auto gpu = gpuTerrain("alpine", {std::string(base->source()), 1}, nullptr, &texture);
  ASSERT_TRUE(gpu);
  const auto places = placesAround({0, 0}, 20'000, 150);
  const auto own = heightsOf(*base, places);
  hold(held, history, {0, 0});
  texture.update(held, {0, 0}, 1000);
  EXPECT_GT(differences(heightsOf(**gpu, places), own), 5000u);
  for (std::uint64_t k = 60; k > 0; --k) ASSERT_TRUE(history.add({edits::Undo{k}, 0}));
  hold(held, history, {0, 0});
  texture.update(held, {0, 0}, 1000);
  EXPECT_EQ(differences(heightsOf(**gpu, places), own), 0u);
}

// Seen from above: the mound hides what lies beneath it, and its material is its colour.
TEST_F(EditTextures, AreMarchedAndColoured) {
  const auto base = terrain::create("alpine", 1).value();
  edits::History history(base);
  ASSERT_TRUE(history.add({edits::Raise{{0, 0}, m(60), m(40), static_cast<std::int32_t>(m(900))}, 8}));
  core::HeldEdits held(32'000);
  hold(held, history, {0, 0});
  EditTexture texture;
  texture.update(held, {0, 0}, 1000);
  auto renderer = Renderer::create({std::string(base->source()), 1});
  ASSERT_TRUE(renderer) << renderer.error().message;
  const edits::EditedTerrain edited(base, history.layer());
  View view;
  view.camera.pose.y = edited.height({0, 0}) + 30;
  view.camera.pose.pitch = -1.5;
  view.camera.projection = {0.9, 32, 32};
  view.horizon = 32'000;
  const HeightBounds own = boundsAround(*base, {0, 0}, 2000), bounds = boundsAround(edited, {0, 0}, 2000);
  EXPECT_GE(bounds.highest, own.highest + 900);
  view.lowest = bounds.lowest;
  view.highest = bounds.highest;
  view.edits = &texture;
  const auto drawn = renderer->drawMarch(view);
  ASSERT_TRUE(drawn);
  const auto positions = renderer->positions();
  const std::size_t centre = 4 * (16 * 32 + 16);
  EXPECT_NEAR(positions[centre + 1], -30, 1);
  const std::uint8_t* const snow = &drawn->picture.rgb[3 * (16 * 32 + 16)];
  EXPECT_GT(int{snow[0]} + snow[1] + snow[2], 500) << "snow in the sun";
}

}  // namespace
}  // namespace ridgecast::render
