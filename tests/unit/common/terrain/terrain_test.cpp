// The laws of Terrain and of curvature, on terrains simple enough to know the answer.

#include "common/terrain/terrain.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <set>

namespace ridgecast::terrain {
namespace {

using lattice::Step;

class Formula final : public Terrain {
 public:
  explicit Formula(std::function<float(Step, Step)> f, std::string source = "formula", std::uint32_t seed = 0)
      : f_(std::move(f)), source_(std::move(source)), seed_(seed) {}
  std::string_view name() const override { return "formula"; }
  std::string_view source() const override { return source_; }
  std::uint32_t seed() const override { return seed_; }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = f_(x[i], z[i]);
  }

 private:
  std::function<float(Step, Step)> f_;
  std::string source_;
  std::uint32_t seed_;
};

float curvatureAt(const Terrain& terrain, Step x, Step z, Step spacing) {
  float out = -1;
  curvatures(terrain, std::span(&x, 1), std::span(&z, 1), spacing, std::span(&out, 1));
  return out;
}

TEST(HeightSteps, roundsToNearestClampsAndTakesNaNAsZero) {
  const float kNaN = std::numeric_limits<float>::quiet_NaN();
  const float kInf = std::numeric_limits<float>::infinity();
  const std::vector<float> metres{0.0f, 1.0f, 0.0019f, 0.0021f, -0.0021f, 131071.0f, 131073.0f, -1e30f, kInf, -kInf, kNaN};
  const std::vector<std::int32_t> steps{
      0, 256, 0, 1, -1, 131071 * 256, lattice::kMaxHeight, -lattice::kMaxHeight, lattice::kMaxHeight, -lattice::kMaxHeight, 0};
  const Formula terrain([&](Step x, Step) { return metres[static_cast<std::size_t>(x)]; });
  for (std::size_t i = 0; i < metres.size(); ++i) {
    EXPECT_EQ(terrain.heightStep({static_cast<Step>(i), 0}), steps[i]) << metres[i];
    EXPECT_EQ(terrain.height({static_cast<Step>(i), 0}), steps[i] / 256.0) << metres[i];
  }
}

TEST(HeightSteps, aLongBatchIsTheSameAsOneByOne) {
  const Formula terrain([](Step x, Step z) { return static_cast<float>(x) * 0.25f + static_cast<float>(z); });
  for (const std::size_t n : {0u, 1u, 255u, 256u, 257u, 1000u}) {
    std::vector<Step> x(n), z(n);
    std::vector<std::int32_t> out(n, -1);
    for (std::size_t i = 0; i < n; ++i) x[i] = static_cast<Step>(i * 7), z[i] = static_cast<Step>(i % 13);
    terrain.heightSteps(x, z, out);
    for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(out[i], terrain.heightStep({x[i], z[i]})) << i << " of " << n;
  }
}

TEST(Curvature, ofALevelPlaneAndOfASlopeIsZero) {
  const Formula level([](Step, Step) { return 1234.5678f; });
  EXPECT_EQ(curvatureAt(level, 5, 9, 256), 0.0f);
  const Formula slope([](Step x, Step z) { return 0.5f * static_cast<float>(x) - 2.0f * static_cast<float>(z) + 7.0f; });
  EXPECT_EQ(curvatureAt(slope, 640, -32, 64), 0.0f);
}

// The kernel is (r^2 - 2) exp(-r^2 / 2) at r^2 = 0, 1, 2, less its mean, divided by the sum of absolute values. A quadratic q sees
// q(1, 0) four times over the edges and q(1, 1) over the corners.
TEST(Curvature, ofAQuadraticIsWhatTheKernelSays) {
  const double mean = (-2.0 + 4 * (-1.0 * std::exp(-0.5)) + 4 * 0.0) / 9;
  const double centre = -2.0 - mean, edge = -std::exp(-0.5) - mean, corner = -mean;
  const double absolute = std::abs(centre) + 4 * std::abs(edge) + 4 * std::abs(corner);
  ASSERT_NEAR(centre + 4 * edge + 4 * corner, 0.0, 1e-15);
  const double a = 3.0 / 65536;  // x^2 a, in metres of steps
  const Formula bowl([&](Step x, Step z) { return static_cast<float>(a * static_cast<double>(x * x + z * z)); });
  // On a bowl a (x^2 + z^2): edges a s^2, corners 2 a s^2, centre 0.
  const double s2 = 256.0 * 256.0;
  const double expected = std::abs(4 * edge * a * s2 + 4 * corner * 2 * a * s2) / absolute;
  EXPECT_NEAR(curvatureAt(bowl, 0, 0, 256), expected, 1e-6);
  EXPECT_NEAR(curvatureAt(bowl, 1024, -512, 256), expected, 1e-5);  // the same everywhere
  EXPECT_NEAR(curvatureAt(bowl, 0, 0, 512), 4 * expected, 1e-5);    // and with the square of the spacing
  // A saddle x^2 - z^2 bends as much up as down.
  const Formula saddle([&](Step x, Step z) { return static_cast<float>(a * static_cast<double>(x * x - z * z)); });
  EXPECT_NEAR(curvatureAt(saddle, 0, 0, 256), 0.0, 1e-7);
}

TEST(Curvature, ofASpikeIsItsHeightTimesTheCentreOfTheKernel) {
  const Formula spike([](Step x, Step z) { return x == 0 && z == 0 ? 10.0f : 0.0f; });
  // Zero sum, unit absolute sum, and two signs: centre and edges are negative, so together they weigh one half.
  const double mean = (-2.0 - 4 * std::exp(-0.5)) / 9;
  const double centre = 2.0 + mean, edges = 4 * (std::exp(-0.5) + mean);
  EXPECT_NEAR(curvatureAt(spike, 0, 0, 1), 10.0 * 0.5 * centre / (centre + edges), 1e-5);
}

TEST(Curvature, aBatchIsTheSameAsOneByOne) {
  const auto terrain = create("alpine", 3).value();
  const std::size_t n = 101;
  std::vector<Step> x(n), z(n);
  std::vector<float> out(n);
  for (std::size_t i = 0; i < n; ++i) x[i] = static_cast<Step>(i) * 4099, z[i] = -static_cast<Step>(i * i) * 17;
  curvatures(*terrain, x, z, 1024, out);
  for (std::size_t i = 0; i < n; ++i) {
    EXPECT_EQ(out[i], curvatureAt(*terrain, x[i], z[i], 1024));
    EXPECT_GE(out[i], 0.0f);
  }
}

TEST(ContentHash, dependsOnTextAndSeedAlone) {
  std::set<std::uint64_t> hashes;
  for (std::uint32_t seed = 0; seed < 1000; ++seed) hashes.insert(contentHash(*create("alpine", seed).value()));
  EXPECT_EQ(hashes.size(), 1000u);
  EXPECT_EQ(contentHash(*create("alpine", 7).value()), contentHash(*create("alpine", 7).value()));
  const auto zero = [](Step, Step) { return 0.0f; };
  const auto one = [](Step, Step) { return 1.0f; };
  EXPECT_EQ(contentHash(Formula(zero, "a", 1)), contentHash(Formula(one, "a", 1)));
  EXPECT_NE(contentHash(Formula(zero, "a", 1)), contentHash(Formula(zero, "b", 1)));
  EXPECT_NE(contentHash(Formula(zero, "ab", 1)), contentHash(Formula(zero, "ba", 1)));
}

TEST(Create, knowsEveryBuiltInAndListsThemOtherwise) {
  ASSERT_FALSE(builtIn().empty());
  for (const Description& d : builtIn()) {
    const auto terrain = create(d.name, 5);
    ASSERT_TRUE(terrain.has_value()) << d.name;
    EXPECT_EQ(terrain.value()->name(), d.name);
    EXPECT_EQ(terrain.value()->seed(), 5u);
    EXPECT_NE(terrain.value()->source().find("float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed)"),
              std::string_view::npos);
    EXPECT_FALSE(d.summary.empty());
  }
  const auto unknown = create("atlantis", 0);
  ASSERT_TRUE(unknown.has_error());
  EXPECT_NE(unknown.error().message.find("atlantis"), std::string::npos);
  for (const Description& d : builtIn()) EXPECT_NE(unknown.error().message.find(d.name), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::terrain
