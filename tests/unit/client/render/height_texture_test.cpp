// Height maps on the client: the window that is held, and the same heights from the graphics driver as from the samples. The drawing
// tests need EGL and skip, saying why, where there is none.
#include "client/render/height_texture.h"

#include <epoxy/gl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "client/render/context.h"
#include "client/render/gpu_terrain.h"
#include "client/render/local_terrain.h"
#include "client/render/surface.h"

namespace ridgecast::render {
namespace {

using terrain::TileAddress;

// An endless map without a file: hills of 900 m with every sample its own.
std::int32_t sampleAt(std::int64_t i, std::int64_t j) {
  const double hills = 115'000 * (std::sin(static_cast<double>(i % 100'000) * 0.013) + std::cos(static_cast<double>(j % 100'000) * 0.017));
  return static_cast<std::int32_t>(hills) + static_cast<std::int32_t>(lattice::mix(static_cast<std::uint64_t>(i * 31 + j)) % 6000);
}
wire::HeightTile tileOf(TileAddress a) {
  auto tile = std::make_unique<terrain::Tile>();
  for (std::int64_t z = 0; z < terrain::kTileSide; ++z)
    for (std::int64_t x = 0; x < terrain::kTileSide; ++x)
      (*tile)[static_cast<std::size_t>(z * terrain::kTileSide + x)] = sampleAt(a.i * terrain::kTileSide + x, a.j * terrain::kTileSide + z);
  return {a, terrain::encodeTile(*tile)};
}
terrain::RasterShape shapeOf(terrain::Pitch pitch, terrain::Pitch along = 0) {
  return {.x = {-1234, pitch},
          .z = {77, along ? along : pitch},
          .width = 1000,
          .height = 1000,
          .lowest = -400'000,
          .highest = 400'000,
          .content = 5};
}
core::HeightWindow windowOf(const terrain::RasterShape& shape, double reach = 32'000) {
  return {"map", terrain::rasterSource(shape), 3, shape, reach};
}
void fill(core::HeightWindow& window, lattice::Point at) {
  window.moveTo(at);
  while (!window.complete())
    for (const TileAddress a : window.take()) ASSERT_TRUE(window.put(tileOf(a)));
}
float expected(const terrain::RasterShape& s, lattice::Step x, lattice::Step z) {
  const auto bx = s.x.at(x), bz = s.z.at(z);
  std::array<std::int32_t, 16> around;
  for (std::int64_t k = 0; k < 16; ++k) around[static_cast<std::size_t>(k)] = sampleAt(bx.sample - 1 + k % 4, bz.sample - 1 + k / 4);
  return terrain::cubicHeight(around, bx.steps(), bz.steps(), s.x.inverse(), s.z.inverse());
}

TEST(HeightWindow, asksNearestFirstAndOnceAndBounded) {
  core::HeightWindow window = windowOf(shapeOf(terrain::pitchOf(2560)));
  window.moveTo({0, 0});
  const auto first = window.take();
  ASSERT_EQ(first.size(), core::HeightWindow::kMax);
  EXPECT_EQ(first[0], window.centre());
  std::int64_t ring = 0;
  for (const TileAddress a : first) {
    const auto r = std::max(std::abs(a.i - window.centre().i), std::abs(a.j - window.centre().j));
    EXPECT_GE(r, ring);
    ring = r;
  }
  EXPECT_TRUE(window.take().empty()) << "asked already";
  EXPECT_FALSE(window.knows({0, 0}));
  EXPECT_EQ(window.knownReach(), 0);
  for (const TileAddress a : first) ASSERT_TRUE(window.put(tileOf(a)));
  EXPECT_TRUE(window.knows({0, 0}));
  EXPECT_GT(window.knownReach(), 3 * 1280.0 - 30) << "three rings around it, less what the cubic needs";
  EXPECT_FALSE(window.put(tileOf(first[0]))) << "not asked for again";
  EXPECT_FALSE(window.put({window.take().at(0), {0x30}})) << "no tile";
}

TEST(HeightWindow, keepsWhatItHasABoundedWhile) {
  core::HeightWindow window = windowOf(shapeOf(terrain::pitchOf(256)), 1e6);
  fill(window, {0, 0});
  const TileAddress home = window.centre();
  fill(window, {256 * 128 * 3, 0});
  fill(window, {0, 0});
  EXPECT_TRUE(window.take().empty());
  for (int k = 1; k < 8; ++k) fill(window, {lattice::Step{k} * 256 * 128 * 15, 0});
  EXPECT_FALSE(window.find(home));
  EXPECT_TRUE(window.complete());
}

TEST(HeightWindow, givesTheHeightsOfItsSamplesAndNothingElsewhere) {
  const auto shape = shapeOf(terrain::pitchOf(2637));
  core::HeightWindow window = windowOf(shape);
  const lattice::Step far = 256'000'000'000'000;
  fill(window, {far, -far});
  std::mt19937_64 random(1);
  for (int k = 0; k < 3000; ++k) {
    const lattice::Step x = far + static_cast<lattice::Step>(random() % 4'000'000) - 2'000'000,
                        z = -far + static_cast<lattice::Step>(random() % 4'000'000) - 2'000'000;
    float h = 0;
    window.heights(std::span(&x, 1), std::span(&z, 1), std::span(&h, 1));
    ASSERT_EQ(h, expected(shape, x, z));
  }
  const lattice::Step origin = 0;
  float h = 0;
  window.heights(std::span(&origin, 1), std::span(&origin, 1), std::span(&h, 1));
  EXPECT_TRUE(std::isnan(h));
}

class HeightTextures : public testing::Test {
 protected:
  void SetUp() override {
    auto made = HeadlessContext::create();
    if (!made) GTEST_SKIP() << "no OpenGL here: " << made.error().message;
    context_ = std::move(*made);
  }
  std::unique_ptr<HeadlessContext> context_;
};

// 100,000 positions each at 0, 1e6, 1e8 and 1e12 m: bit for bit with llvmpipe; drivers that fuse multiplication and addition may differ
// by a step.
TEST_F(HeightTextures, giveTheSameHeightsAsTheSamples) {
  const bool exact = contextDescription().find("llvmpipe") != std::string::npos;
  const std::pair<terrain::Pitch, terrain::Pitch> pitches[] = {{terrain::kMinPitch, 0},
                                                               {terrain::pitchOf(2637), 0},
                                                               {terrain::pitchOf(7680), 0},
                                                               {terrain::kMaxPitch, 0},
                                                               {26'843'546, 0},                            // 10 cm
                                                               {terrain::kMinPitch + 1, 104'960'000'001},  // oblong
                                                               {terrain::kMaxPitch - 1, terrain::kMinPitch}};
  for (const auto& [pitch, along] : pitches) {
    const auto shape = shapeOf(pitch, along);
    core::HeightWindow window = windowOf(shape, 1e9);
    HeightTexture texture(shape);
    for (const double distance : {0.0, 1e6, 1e8, 1e12}) {
      const auto centre = static_cast<lattice::Step>(distance * 256);
      fill(window, {centre, -centre});
      ASSERT_TRUE(texture.update(window, 1000));
      const auto gpu = gpuTerrain("map", {std::string(window.source()), 3, false, false, true}, &texture);
      ASSERT_TRUE(gpu) << gpu.error().message;
      std::mt19937_64 random(pitch);
      const std::size_t count = 100'000 / (pitch == terrain::pitchOf(7680) ? 1 : 4);
      const lattice::Step spread = shape.x.of(terrain::kTileSide * 6) - shape.x.origin,
                          along6 = shape.z.of(terrain::kTileSide * 6) - shape.z.origin;
      std::vector<lattice::Step> x(count), z(count);
      for (std::size_t k = 0; k < count; ++k) {
        x[k] = centre + static_cast<lattice::Step>(random() % static_cast<std::uint64_t>(2 * spread)) - spread;
        z[k] = -centre + static_cast<lattice::Step>(random() % static_cast<std::uint64_t>(2 * along6)) - along6;
      }
      std::vector<float> drawn(count);
      (*gpu)->heights(x, z, drawn);
      std::size_t different = 0;
      double worst = 0;
      for (std::size_t k = 0; k < count; ++k) {
        const float right = expected(shape, x[k], z[k]);
        different += std::bit_cast<std::uint32_t>(right) != std::bit_cast<std::uint32_t>(drawn[k]);
        worst = std::max(worst, std::abs(static_cast<double>(right) - drawn[k]));
      }
      EXPECT_LE(worst, 1.0 / 256) << pitch << " at " << distance;
      if (exact) {
        EXPECT_EQ(different, 0u) << pitch << " at " << distance;
      }
    }
  }
}

// Of a picture whose colour is that of the tile, with a hole: at samples, between them, from afar, and beyond the window.
TEST_F(HeightTextures, haveThePictureOnTheMap) {
  auto shape = shapeOf(terrain::pitchOf(7680));
  shape.draped = true;
  core::HeightWindow window = windowOf(shape);
  const auto byteOf = [](TileAddress a, std::size_t channel) { return static_cast<std::uint8_t>(120 + 9 * (channel == 0 ? a.i : a.j)); };
  const auto isHole = [](TileAddress a) { return a.i == 1 && a.j == 1; };
  while (!window.complete())
    for (const TileAddress a : window.take()) {
      wire::HeightTile tile = tileOf(a);
      for (std::size_t k = 0; !isHole(a) && k < terrain::kTileColourBytes; ++k) tile.colours.push_back(k % 4 == 3 ? 255 : byteOf(a, k % 4));
      ASSERT_TRUE(window.put(tile));
    }
  const TileAddress next = window.centre();
  window.moveTo({shape.x.of((next.i + 1) * terrain::kTileSide), 0});
  wire::HeightTile cut = tileOf(window.take().at(0));
  cut.colours.resize(77);
  EXPECT_FALSE(window.put(cut));
  window.moveTo({0, 0});

  HeightTexture texture(shape);
  ASSERT_TRUE(texture.update(window, 1000));
  const auto colourAt = [&](bool draped, double i, double j, double footprint) {
    const TerrainText text{std::string(window.source()), 3, false, false, true, draped};
    const std::string main =
        "uniform ivec4 place; uniform float footprint; layout(location = 0) out vec4 colour;\nvoid main() { colour = "
        "vec4(terrainColor(place.xy, vec2(place.zw) / 1048576.0, 400.0, vec3(0.0, 1.0, 0.0), footprint, 3u), 1.0); }";
    const auto program = buildTerrainProgram("colour", text, main);
    EXPECT_TRUE(program) << program.error().message;
    const lattice::Step x = shape.x.origin + std::llround(i * shape.x.steps()), z = shape.z.origin + std::llround(j * shape.z.steps());
    constexpr lattice::Step kInCell = (lattice::Step{1} << lattice::kCellBits) - 1;
    const Target target(GL_RGBA32F, 1, 1);
    drawInto(target.framebuffer(), 1, 1);
    program->use();
    glUniform4i(program->location("place"), lattice::cellOf(x), lattice::cellOf(z), static_cast<int>(x & kInCell),
                static_cast<int>(z & kInCell));
    program->set("footprint", static_cast<float>(footprint * shape.x.metres()));
    texture.bind(*program);
    program->drawFullScreen();
    std::array<float, 4> out{};
    glReadPixels(0, 0, 1, 1, GL_RGBA, GL_FLOAT, out.data());
    return out;
  };
  const auto linear = [](double byte) { return std::pow((byte / 255 + 0.055) / 1.055, 2.4); };
  for (const TileAddress a : {TileAddress{0, 0}, TileAddress{2, -1}, TileAddress{-3, 3}})
    for (const double footprint : {0.1, 1.0, 6.0, 20.0}) {
      const auto found = colourAt(true, static_cast<double>(a.i * 128) + 63.4, static_cast<double>(a.j * 128) + 64.7, footprint);
      for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[c], linear(byteOf(a, c)), 0.004) << a.i << " " << footprint;
    }
  const auto border = colourAt(true, 127.5, 40, 1), afar = colourAt(true, 128, 40, 128);
  EXPECT_NEAR(border[0], (linear(120) + linear(129)) / 2, 0.004);
  EXPECT_NEAR(afar[0], (linear(120) + linear(129)) / 2, 0.02);
  for (const auto& [i, j] : {std::pair{192.0, 192.0}, {1e5, 0.0}, {-1e5, 0.0}}) {
    const auto own = colourAt(false, i, j, 1), found = colourAt(true, i, j, 1);
    EXPECT_EQ(found, own) << i;
    EXPECT_GT(own[0], 0.01);
  }
}

TEST_F(HeightTextures, knowNothingBeyondTheWindow) {
  const auto shape = shapeOf(terrain::pitchOf(7680));
  core::HeightWindow window = windowOf(shape);
  HeightTexture texture(shape);
  fill(window, {0, 0});
  texture.update(window, 1000);
  const auto gpu = gpuTerrain("map", {std::string(window.source()), 3, false, false, true}, &texture).value();
  const std::vector<lattice::Step> x{0, 256 * 60'000, 256 * 400'000, -256 * 400'000, 0}, z{0, 0, 0, 0, 256 * 100'000};
  std::vector<float> h(x.size());
  gpu->heights(x, z, h);
  EXPECT_GT(h[0], -2000);
  for (std::size_t k = 1; k < h.size(); ++k) EXPECT_EQ(h[k], -131072.0f) << k;
}

TEST_F(HeightTextures, aHeightMapsWorldNeedsNoTextFromTheServer) {
  wire::World world;
  world.terrainName = "map";
  world.seed = 3;
  world.horizon = 32'000;
  world.heightMap = shapeOf(terrain::pitchOf(7680));
  world.terrainSource = terrain::rasterSource(*world.heightMap);
  for (const bool remote : {true, false}) {
    const Drawing d = drawingOf(world, remote);
    EXPECT_TRUE(d.why.empty()) << d.why;
    EXPECT_TRUE(d.text.raster && d.window && d.terrain);
  }
  world.terrainSource += "\nfloat other() { return 1.0; }\n";
  EXPECT_TRUE(drawingOf(world, true).window);
  EXPECT_THAT(drawingOf(world, false).why, testing::HasSubstr("--no-remote-shaders"));
  world.terrainSource = "nonsense";
  EXPECT_TRUE(drawingOf(world, true).text.neutral);
}

}  // namespace
}  // namespace ridgecast::render
