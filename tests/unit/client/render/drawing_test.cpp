// What the two renderings draw, against geometry worked out here. Needs EGL; says so and skips where there is none.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "client/evaluation/ssim.h"
#include "client/render/context.h"
#include "client/render/renderer.h"
#include "common/terrain/terrain.h"
#include "tests/support/rays.h"

namespace ridgecast::render {
namespace {

using Leaves = std::map<lattice::LeafAddress, core::HeldLeaf>;

// A world that is flat at 100 m, with squares of 8 m in two colours.
const char* const kPlain = R"(
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 100.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {
  ivec2 square = ivec2(floor(fraction * 512.0));
  return ((square.x + square.y) & 1) == 0 ? vec3(0.7, 0.1, 0.1) : vec3(0.1, 0.1, 0.5);
}
)";

class DrawingTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    auto made = HeadlessContext::create();
    if (made)
      context_ = std::move(*made);
    else
      reason_ = made.error().message;
  }
  static void TearDownTestSuite() { context_.reset(); }
  void SetUp() override {
    if (!context_) GTEST_SKIP() << "no OpenGL here: " << reason_;
  }
  static Renderer renderer(std::string source) {
    auto made = Renderer::create({std::move(source), 1});
    EXPECT_TRUE(made) << made.error().message;
    return std::move(*made);
  }
  static inline std::unique_ptr<HeadlessContext> context_;
  static inline std::string reason_;
};

core::HeldLeaf hold(std::shared_ptr<const mesh::LeafMesh> leaf, std::uint64_t version) {
  core::HeldLeaf held;
  held.mesh = std::move(leaf);
  held.version = version;
  if (!held.mesh->vertices.empty()) held.low = held.high = held.mesh->vertices.front();
  for (const mesh::LocalVertex& v : held.mesh->vertices) {
    held.low = {std::min(held.low.x, v.x), std::min(held.low.z, v.z), std::min(held.low.y, v.y)};
    held.high = {std::max(held.high.x, v.x), std::max(held.high.z, v.z), std::max(held.high.y, v.y)};
  }
  return held;
}

// Two triangles that fill a leaf's square at a height in steps.
core::HeldLeaf flatLeaf(lattice::LeafAddress address, std::int32_t y, std::uint64_t version = 1) {
  auto leaf = std::make_shared<mesh::LeafMesh>();
  leaf->address = address;
  const auto side = static_cast<std::int32_t>(address.side());
  leaf->vertices = {{0, 0, y}, {0, side, y}, {side, 0, y}, {side, side, y}};
  leaf->triangles = {{0, 1, 2}, {1, 3, 2}};
  return hold(leaf, version);
}

View viewFrom(double x, double y, double z, double yaw, double pitch, std::uint32_t width, std::uint32_t height) {
  View view;
  view.camera.pose.x = std::llround(x * 256);
  view.camera.pose.z = std::llround(z * 256);
  view.camera.pose.y = y;
  view.camera.pose.yaw = yaw;
  view.camera.pose.pitch = pitch;
  view.camera.projection.width = width;
  view.camera.projection.height = height;
  view.horizon = 32000;
  view.lowest = -10;
  view.highest = 3000;
  return view;
}

// Where the ray through the middle of a pixel meets the plane y = height, in metres from the camera; nothing above the horizon.
std::optional<std::array<double, 2>> meets(const View& view, double height, std::uint32_t column, std::uint32_t row) {
  const camera::Projection& q = view.camera.projection;
  const double tangent = std::tan(q.verticalFov / 2), sx = ((column + 0.5) / q.width * 2 - 1) * tangent * q.width / q.height;
  const double sy = (1 - (row + 0.5) / q.height * 2) * tangent, yaw = view.camera.pose.yaw, pitch = view.camera.pose.pitch;
  // In the camera's frame the ray is (sx, sy, -1); turned up by the pitch, then left by the yaw.
  const double y = sy * std::cos(pitch) + std::sin(pitch), back = sy * std::sin(pitch) - std::cos(pitch);
  const double x = sx * std::cos(yaw) + back * std::sin(yaw), z = -sx * std::sin(yaw) + back * std::cos(yaw);
  if (y >= 0) return std::nullopt;
  const double t = (height - view.camera.pose.y) / y;
  return std::array<double, 2>{x * t, z * t};
}

TEST_F(DrawingTest, AFlatLeafCoversThePixelsThatGeometrySays) {
  Renderer r = renderer(kPlain);
  for (const lattice::LeafAddress address : {lattice::LeafAddress{0, 0, 0}, lattice::LeafAddress{0, 31250000000, -31250000000}}) {
    const double x0 = static_cast<double>(address.x()) / 256, z0 = static_cast<double>(address.z()) / 256;
    const View view = viewFrom(x0 + 10, 140, z0 + 50, 0.3, -0.7, 200, 120);
    const auto drawn = r.drawMesh(Leaves{{address, flatLeaf(address, 100 * 256)}}, view);
    ASSERT_TRUE(drawn);
    int inside = 0;
    for (std::uint32_t row = 0; row < 120; ++row)
      for (std::uint32_t column = 0; column < 200; ++column) {
        const auto at = meets(view, 100, column, row);
        // Distance inside the square, in metres; pixels within 0.5 m of its edge may go either way.
        const double depth =
            at ? std::min(std::min((*at)[0] + 10, 32 - ((*at)[0] + 10)), std::min((*at)[1] + 50, 32 - ((*at)[1] + 50))) : -1e9;
        if (std::abs(depth) < 0.5) continue;
        inside += depth > 0;
        ASSERT_EQ(drawn->picture.terrain[row * 200 + column], depth > 0 ? 255 : 0) << "column " << column << ", row " << row;
      }
    EXPECT_GT(inside, 1000);
  }
}

TEST_F(DrawingTest, BothRenderingsOfAPlainAreTheSamePictureAndFollowItsSquares) {
  Renderer r = renderer(kPlain);
  Leaves leaves;
  for (int i = -1; i <= 0; ++i)
    for (int j = -1; j <= 0; ++j) leaves[{lattice::kMaxLevel, i, j}] = flatLeaf({lattice::kMaxLevel, i, j}, 100 * 256);
  const View view = viewFrom(3, 120, 5, 0.5, -0.35, 320, 180);
  const auto mesh = r.drawMesh(leaves, view), march = r.drawMarch(view);
  ASSERT_TRUE(mesh && march);
  const auto similar = evaluation::similarity(mesh->picture, march->picture);
  EXPECT_GT(similar.mean, 0.995);
  EXPECT_GT(similar.terrainShare, 0.5);
  int checked = 0;
  for (std::uint32_t row = 0; row < 180; ++row)
    for (std::uint32_t column = 0; column < 320; ++column) {
      const auto at = meets(view, 100, column, row);
      if (!at || std::hypot((*at)[0], (*at)[1]) > 120) continue;
      const double x = ((*at)[0] + 3) / 8, z = ((*at)[1] + 5) / 8;
      if (std::abs(x - std::round(x)) < 0.1 || std::abs(z - std::round(z)) < 0.1) continue;
      const bool red = ((static_cast<int>(std::floor(x)) + static_cast<int>(std::floor(z))) & 1) == 0;
      const std::size_t pixel = 3 * (row * 320 + column);
      ASSERT_EQ(mesh->picture.rgb[pixel] > mesh->picture.rgb[pixel + 2], red) << "column " << column << ", row " << row;
      ASSERT_EQ(march->picture.rgb[pixel] > march->picture.rgb[pixel + 2], red) << "column " << column << ", row " << row;
      ++checked;
    }
  EXPECT_GT(checked, 5000);
}

TEST_F(DrawingTest, FarFromTheOriginIsDrawnLikeTheOrigin) {
  Renderer r = renderer(kPlain);
  constexpr double kFar = 4096.0 * 244140625;  // 1e12 m, a whole number of cells
  for (const bool march : {false, true}) {
    std::array<Picture, 2> pictures;
    for (int k = 0; k < 2; ++k) {
      const double shift = k * kFar;
      Leaves leaves;
      const lattice::LeafAddress address{6, std::llround(shift / 2048), std::llround(shift / 2048)};
      leaves[address] = flatLeaf(address, 100 * 256);
      const View view = viewFrom(shift + 1000, 108, shift + 1900, 0.2, -0.2, 160, 90);
      const auto drawn = march ? r.drawMarch(view) : r.drawMesh(leaves, view);
      ASSERT_TRUE(drawn);
      pictures[static_cast<std::size_t>(k)] = drawn->picture;
    }
    EXPECT_EQ(pictures[0].rgb, pictures[1].rgb);
    EXPECT_EQ(pictures[0].terrain[160 * 80 + 80], 255);
  }
}

TEST_F(DrawingTest, ReplacedAndDroppedLeavesLeaveThePicture) {
  Renderer r = renderer(kPlain);
  const lattice::LeafAddress left{0, -1, 0}, right{0, 0, 0};
  const View view = viewFrom(0, 160, 16, 0, -1.5, 64, 64);
  const auto terrain = [&](const Leaves& leaves, std::size_t column) {
    const auto drawn = r.drawMesh(leaves, view);
    EXPECT_TRUE(drawn);
    return drawn->picture.terrain[32 * 64 + column] == 255;
  };
  Leaves leaves{{left, flatLeaf(left, 100 * 256, 1)}, {right, flatLeaf(right, 100 * 256, 2)}};
  EXPECT_TRUE(terrain(leaves, 25));
  EXPECT_TRUE(terrain(leaves, 39));
  leaves.erase(left);
  EXPECT_FALSE(terrain(leaves, 25));
  EXPECT_TRUE(terrain(leaves, 39));
  auto empty = std::make_shared<mesh::LeafMesh>();
  empty->address = right;
  leaves[right] = hold(empty, 3);
  EXPECT_FALSE(terrain(leaves, 39));
  leaves[left] = flatLeaf(left, 100 * 256, 4);
  EXPECT_TRUE(terrain(leaves, 25));
}

TEST_F(DrawingTest, NearerLeavesHideFartherOnesAtEveryDistance) {
  // Two sheets 2 m apart, seen from above, 100 m to 30 km away: the upper one must win everywhere.
  Renderer r = renderer(R"(
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 0.0; }
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
)");
  const lattice::LeafAddress upper{lattice::kMaxLevel, 0, -1}, lower{lattice::kMaxLevel, -1, -1};
  Leaves leaves{{upper, flatLeaf(upper, 102 * 256)}};
  View view = viewFrom(16000, 3000, 0, 0, -0.3, 320, 180);
  view.horizon = 40000;
  const auto alone = r.drawMesh(leaves, view);
  auto sheet = std::make_shared<mesh::LeafMesh>(*flatLeaf(upper, 100 * 256).mesh);
  const auto side = static_cast<std::int32_t>(upper.side());
  for (auto& v : sheet->vertices) v.x += side;  // the same square, held by the neighbour
  sheet->address = lower;
  leaves[lower] = hold(sheet, 2);
  const auto both = r.drawMesh(leaves, view);
  ASSERT_TRUE(alone && both);
  EXPECT_EQ(alone->picture.rgb, both->picture.rgb);
}

// Behind the valley stands a wall of 85 degrees whose upper edge long steps pass over: sky then shows through the mountain.
TEST_F(DrawingTest, TheRayMarchDoesNotStepOverCliffs) {
  const auto terrain = terrain::create("alpine", 1);
  ASSERT_TRUE(terrain);
  Renderer r = renderer(std::string((*terrain)->source()));
  View view = viewFrom(1750, 2160, 2620, 8 * std::numbers::pi / 180, -13 * std::numbers::pi / 180, 320, 180);
  view.horizon = 32'000;
  const HeightBounds bounds = boundsAround(**terrain, {view.camera.pose.x, view.camera.pose.z}, view.horizon);
  view.lowest = bounds.lowest;
  view.highest = bounds.highest;
  const auto normal = r.drawMarch(view), finer = r.drawMarch(view, 1, 4);
  ASSERT_TRUE(normal && finer);
  std::size_t holes = 0;
  for (std::size_t k = 0; k < finer->picture.terrain.size(); ++k) holes += normal->picture.terrain[k] < finer->picture.terrain[k];
  EXPECT_LE(holes, 5u);
}

// The true heights of a leaf on a grid of so many cells a side.
// Level ground at 100 m, an abyss of a kilometre south of z = 0, and on its rim a fence 150 m high and 4 m wide: what the overshoot of a
// height map's edge is like. A march that stepped by the gap alone jumped over it and drew streaks.
const char* const kFence = R"(
float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {
  float z = (float(cell.y) + fraction.y) * 4096.0;
  return z > 0.0 ? -900.0 : z > -4.0 ? 250.0 : 100.0;
}
vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return vec3(0.5); }
)";

class Fence : public terrain::Terrain {
 public:
  std::string_view name() const override { return "fence"; }
  std::string_view source() const override { return kFence; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < z.size(); ++k) {
      const float at = static_cast<float>(z[k]) / 256;
      out[k] = at > 0 ? -900.0f : at > -4 ? 250.0f : 100.0f;
    }
  }
};

// Against a march on the processor that is sixteen times finer and skips nothing: nearly every ray meets the ground at the same distance,
// whatever the pose.
TEST_F(DrawingTest, TheRayMarchMeetsWhatAMuchFinerOneMeets) {
  constexpr std::uint32_t kWidth = 112, kHeight = 63, kApart = 2;  // every other ray of a picture
  std::mt19937_64 random(3);
  const auto between = [&](double low, double high) { return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53; };
  std::vector<std::shared_ptr<const terrain::Terrain>> terrains = {std::make_shared<Fence>()};
  for (const char* name : {"alpine", "canyon", "archipelago"}) terrains.push_back(terrain::create(name, 1).value());
  for (const auto& ground : terrains) {
    Renderer r = renderer(std::string(ground->source()));
    std::size_t rays = 0, astray = 0;
    for (int k = 0; k < 4; ++k) {
      const bool fence = ground == terrains.front();
      const double x = between(-1e5, 1e5), z = fence ? between(100, 900) : between(-1e5, 1e5),
                   altitude = std::exp(between(std::log(1.5), std::log(3000))),
                   foot = ground->height({std::llround(x * 256), std::llround(z * 256)});
      // At the fence from the abyss upwards, and from above.
      const double y = !fence ? foot + altitude : k % 2 ? between(300, 900) : between(-890, 150);
      View view = viewFrom(x, y, z, fence ? between(-0.6, 0.6) : between(0, 6.28),
                           fence ? std::atan2(100 - y, z) + between(-0.05, 0.15) : between(-1.4, 0.5), kWidth, kHeight);
      if (fence) view.camera.projection.verticalFov = 0.2;  // so that it is several samples wide
      view.horizon = 20'000;
      view.highest = 9000;
      view.lowest = -1000;
      ASSERT_TRUE(r.drawMarch(view));
      const std::vector<float> drawn = r.positions();
      const camera::Vec3 f = camera::forward(view.camera.pose), right = camera::right(view.camera.pose), up = camera::up(view.camera.pose);
      std::vector<camera::Vec3> directions;
      std::vector<const float*> seen;
      const double tangent = std::tan(view.camera.projection.verticalFov / 2);
      for (std::uint32_t row = 0; row < kHeight; row += kApart)
        for (std::uint32_t column = 0; column < kWidth; column += kApart) {
          const double a = tangent * kWidth / kHeight * ((column + 0.5) / kWidth * 2 - 1), b = tangent * (1 - (row + 0.5) / kHeight * 2);
          const camera::Vec3 d{f.x + a * right.x + b * up.x, f.y + a * right.y + b * up.y, f.z + a * right.z + b * up.z};
          const double length = std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
          directions.push_back({d.x / length, d.y / length, d.z / length});
          seen.push_back(&drawn[4 * (std::size_t{row} * kWidth + column)]);
        }
      std::vector<double> truth(directions.size(), view.horizon);
      for (const auto& hit : testing_support::castRays(*ground, view.camera, directions, 16)) truth[hit.ray] = hit.distance;
      for (std::size_t n = 0; n < truth.size(); ++n, ++rays) {
        const float* at = seen[n];
        const double distance = at[3] > 0 ? std::sqrt(double(at[0]) * at[0] + double(at[1]) * at[1] + double(at[2]) * at[2]) : view.horizon;
        astray += std::abs(distance - truth[n]) > 0.02 * truth[n];
      }
    }
    EXPECT_LE(static_cast<double>(astray), 0.002 * static_cast<double>(rays)) << ground->name() << ": " << astray << " of " << rays;
  }
}

core::HeldLeaf sampledLeaf(const terrain::Terrain& terrain, lattice::LeafAddress address, std::int32_t cells) {
  auto leaf = std::make_shared<mesh::LeafMesh>();
  leaf->address = address;
  std::vector<lattice::Step> xs, zs;
  const lattice::Step spacing = address.side() / cells;
  for (std::int32_t i = 0; i <= cells; ++i)
    for (std::int32_t j = 0; j <= cells; ++j) {
      xs.push_back(address.x() + i * spacing);
      zs.push_back(address.z() + j * spacing);
    }
  std::vector<std::int32_t> heights(xs.size());
  terrain.heightSteps(xs, zs, heights);
  for (std::size_t k = 0; k < xs.size(); ++k)
    leaf->vertices.push_back({static_cast<std::int32_t>(xs[k] - address.x()), static_cast<std::int32_t>(zs[k] - address.z()), heights[k]});
  const auto n = static_cast<std::uint32_t>(cells);
  for (std::uint32_t i = 0; i < n; ++i)
    for (std::uint32_t j = 0; j < n; ++j) {
      const std::uint32_t a = i * (n + 1) + j, b = a + n + 1;
      leaf->triangles.push_back({a, a + 1, b});
      leaf->triangles.push_back({a + 1, b + 1, b});
    }
  return hold(leaf, 1);
}

TEST_F(DrawingTest, TheRayMarchDrawsTheHeightsThatTheServerTriangulates) {
  // Looking straight down, the middle of the picture is the terrain below: fine grids from the C++ heights must give the same picture.
  const auto terrain = terrain::create("alpine", 1);
  ASSERT_TRUE(terrain);
  Renderer r = renderer(std::string((*terrain)->source()));
  const lattice::LeafAddress address{2, 15, 11};  // 128 m
  View view = viewFrom((static_cast<double>(address.x()) / 256) + 64, 0, static_cast<double>(address.z()) / 256 + 64, 0, -1.57, 160, 160);
  view.camera.pose.y = (*terrain)->height({view.camera.pose.x, view.camera.pose.z}) + 70;
  view.camera.projection.verticalFov = 0.8;
  view.highest = 8000;
  const auto mesh = r.drawMesh(Leaves{{address, sampledLeaf(**terrain, address, 256)}}, view), march = r.drawMarch(view);
  ASSERT_TRUE(mesh && march);
  EXPECT_GT(evaluation::similarity(mesh->picture, march->picture).mean, 0.98);
}

// A mesh of cells of 16 m, from above: corrected it must show the ray march's picture, at points that the C++ heights confirm.
TEST_F(DrawingTest, CorrectedSamplesLieOnTheTrueSurface) {
  const auto terrain = terrain::create("alpine", 1);
  ASSERT_TRUE(terrain);
  Renderer r = renderer(std::string((*terrain)->source()));
  const lattice::LeafAddress address{4, 3, 2};  // 512 m
  const Leaves leaves{{address, sampledLeaf(**terrain, address, 32)}};
  View view =
      viewFrom((static_cast<double>(address.x()) / 256) + 256, 0, static_cast<double>(address.z()) / 256 + 256, 0.3, -1.5, 240, 160);
  view.camera.pose.y = (*terrain)->height({view.camera.pose.x, view.camera.pose.z}) + 250;
  view.camera.projection.verticalFov = 0.7;
  view.highest = 8000;
  // The least and the greatest height of what is seen above the terrain, as a share of the samples that are nearer than 0.1 m.
  const auto near = [&] {
    const std::vector<float> seen = r.positions();
    EXPECT_EQ(seen.size(), std::size_t{4} * 240 * 160);
    std::size_t close = 0, all = 0;
    for (std::size_t k = 0; k < seen.size(); k += 4) {
      if (seen[k + 3] == 0) continue;
      const lattice::Point at{view.camera.pose.x + std::llround(seen[k] * 256), view.camera.pose.z + std::llround(seen[k + 2] * 256)};
      ++all;
      close += std::abs((*terrain)->height(at) - (view.camera.pose.y + seen[k + 1])) < 0.1;
    }
    EXPECT_GT(all, seen.size() / 5);
    return static_cast<double>(close) / static_cast<double>(all);
  };
  const auto march = r.drawMarch(view);
  ASSERT_TRUE(march);
  EXPECT_GT(near(), 0.99);
  const auto mesh = r.drawMesh(leaves, view);
  ASSERT_TRUE(mesh);
  const double before = near();
  const auto corrected = r.drawCorrected(leaves, view);
  ASSERT_TRUE(corrected);
  EXPECT_GT(near(), 0.95);
  EXPECT_LT(before, 0.7);
  const double plain = evaluation::similarity(mesh->picture, march->picture).mean;
  const double better = evaluation::similarity(corrected->picture, march->picture).mean;
  EXPECT_GT(better, 0.97);
  EXPECT_GT(1 - plain, 3 * (1 - better)) << plain << " against " << better;
  EXPECT_EQ(mesh->picture.terrain, corrected->picture.terrain);  // there is no sky
}

// Ground that the mesh lacks stands out over what lies behind it, the sky or other ground: corrected, it is there.
TEST_F(DrawingTest, CorrectedSilhouettesAreTheTrueOnes) {
  const auto terrain = terrain::create("alpine", 1);
  ASSERT_TRUE(terrain);
  Renderer r = renderer(std::string((*terrain)->source()));
  const lattice::LeafAddress address{7, 0, 0};  // 4,096 m
  const Leaves leaves{{address, sampledLeaf(**terrain, address, 128)}};
  // Samples where `shown` has nothing, or what lies at least a tenth farther, or the other way round; far from where the picture ends.
  const auto farther = [](const std::vector<float>& shown, const std::vector<float>& truth, double horizon) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < truth.size(); k += 4) {
      const double a = shown[k + 3] == 0 ? horizon : std::hypot(shown[k], shown[k + 1], shown[k + 2]);
      const double b = truth[k + 3] == 0 ? horizon : std::hypot(truth[k], truth[k + 1], truth[k + 2]);
      count += b < 0.8 * horizon && a > 1.1 * b;
    }
    return count;
  };
  std::size_t lacking = 0, left = 0, added = 0;
  for (const double yaw : {0.3, 1.9, 3.5, 5.1}) {
    View view = viewFrom(2048, 0, 2048, yaw, -0.1, 240, 160);
    view.camera.pose.y = (*terrain)->height({view.camera.pose.x, view.camera.pose.z}) + 120;
    view.horizon = 2000;  // all of it on the leaf
    view.highest = 8000;
    ASSERT_TRUE(r.drawMarch(view));
    const std::vector<float> march = r.positions();
    ASSERT_TRUE(r.drawMesh(leaves, view));
    lacking += farther(r.positions(), march, view.horizon);
    ASSERT_TRUE(r.drawCorrected(leaves, view));
    left += farther(r.positions(), march, view.horizon);
    added += farther(march, r.positions(), view.horizon);
  }
  EXPECT_GT(lacking, 300u);
  EXPECT_LT(3 * left, lacking) << left << " of " << lacking;
  EXPECT_LT(10 * added, lacking) << "ground that there is not";
}

// Shaded at no width the same squares are drawn, harder; what was seen stays where it was.
TEST_F(DrawingTest, ColouringAnewChangesColoursAlone) {
  const auto terrain = terrain::create("alpine", 1);
  ASSERT_TRUE(terrain);
  Renderer r = renderer(std::string((*terrain)->source()));
  View view = viewFrom(2000, 0, 1500, 0.4, -0.3, 160, 96);
  view.camera.pose.y = (*terrain)->height({view.camera.pose.x, view.camera.pose.z}) + 250;
  const auto filtered = r.drawMarch(view, 2);
  ASSERT_TRUE(filtered);
  const std::vector<float> seen = r.positions();
  const auto again = r.shadeAgain(view, 2);
  view.filtered = false;
  const auto points = r.shadeAgain(view, 2);
  ASSERT_TRUE(again && points);
  EXPECT_EQ(again->picture.rgb, filtered->picture.rgb);
  EXPECT_NE(points->picture.rgb, filtered->picture.rgb);
  EXPECT_EQ(points->picture.terrain, filtered->picture.terrain);
  EXPECT_EQ(r.positions(), seen);
  EXPECT_FALSE(r.shadeAgain(view, 1));
}

TEST_F(DrawingTest, ShaderErrorsNameTheTerrainAndItsLine) {
  const auto made =
      Renderer::create({"float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n  return nonsense;\n}\n", 1});
  ASSERT_FALSE(made);
  EXPECT_NE(made.error().message.find("nonsense"), std::string::npos) << made.error().message;
  EXPECT_NE(made.error().message.find("2 = terrain"), std::string::npos) << made.error().message;
}

TEST_F(DrawingTest, PicturesLargerThanTheDriverDrawsAreRefused) {
  Renderer r = renderer(kPlain);
  const auto drawn = r.drawMesh(Leaves{}, viewFrom(0, 0, 0, 0, 0, 30000, 30000), 4);
  ASSERT_FALSE(drawn);
  EXPECT_NE(drawn.error().message.find("--size"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::render
