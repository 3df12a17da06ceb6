#include "common/ground/ground.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

namespace ridgecast::ground {
namespace {

using lattice::Step;

// A terrain that is any function of metres.
class Made final : public terrain::Terrain {
 public:
  explicit Made(std::function<double(double, double)> f) : f_(std::move(f)) {}
  std::string_view name() const override { return "made"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 0; }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = static_cast<float>(f_(static_cast<double>(x[k]) / 256, static_cast<double>(z[k]) / 256));
  }

 private:
  std::function<double(double, double)> f_;
};

TEST(Ground, NormalsOfAPlaneAreThePlanes) {
  const Made plane([](double x, double z) { return 0.5 * x - 0.25 * z + 7; });
  std::vector<Step> x, z;
  for (Step k = 0; k < 200; ++k) x.push_back(k * 777 - 50'000), z.push_back(90'000 - k * 1001);
  std::vector<float> out(3 * x.size());
  normals(plane, x, z, 64, out);
  const double length = std::sqrt(0.25 + 1 + 0.0625);
  for (std::size_t k = 0; k < x.size(); ++k) {
    EXPECT_NEAR(out[3 * k], -0.5 / length, 1e-4);
    EXPECT_NEAR(out[3 * k + 1], 1 / length, 1e-4);
    EXPECT_NEAR(out[3 * k + 2], 0.25 / length, 1e-4);
  }
}

TEST(Ground, NormalsAreUnitsUpToTheEndOfTheLattice) {
  const auto alpine = terrain::create("alpine", 1).value();
  const std::vector<Step> x{0, lattice::kMaxPosition, -lattice::kMaxPosition, 12'345},
      z{0, lattice::kMaxPosition, 5, -lattice::kMaxPosition};
  std::vector<float> out(12);
  for (std::uint32_t spacing : {1u, 16u, 65'536u}) {
    normals(*alpine, x, z, spacing, out);
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(std::hypot(out[3 * k], out[3 * k + 1], out[3 * k + 2]), 1, 1e-6);
      EXPECT_GT(out[3 * k + 1], 0);
    }
  }
}

TEST(Ground, ASpacingOfZeroIsTheDefault) {
  const auto alpine = terrain::create("alpine", 1).value();
  const std::vector<Step> x{0, 12'345}, z{-7, 99};
  std::vector<float> out(6), byDefault(6);
  normals(*alpine, x, z, 0, out);
  normals(*alpine, x, z, terrain::kDefaultSpacing, byDefault);
  EXPECT_EQ(out, byDefault);
}

TEST(GroundDeathTest, ARayHasADirectionAndAnEnd) {
  const Made plane([](double, double) { return 0.0; });
  EXPECT_DEATH(cast(plane, {.y = 1, .directionY = 1, .reach = std::numeric_limits<double>::quiet_NaN()}), "a ray ends");
  EXPECT_DEATH(cast(plane, {.y = 1, .reach = 10}), "a ray has a direction");
}

TEST(Ground, RaysMeetAPlaneWhereGeometrySays) {
  const Made flat([](double, double) { return 100; });
  EXPECT_NEAR(cast(flat, {0, 0, 150, 0, -1, 0, 1000}), 50, 1e-5);
  EXPECT_NEAR(cast(flat, {0, 0, 150, 3, -4, 0, 1000}), 62.5, 1e-4) << "the direction has any length";
  EXPECT_NEAR(cast(flat, {5, -7, 101, 1e-6, -1e-6, 0, 1000}), std::sqrt(2.0), 1e-4);
  EXPECT_EQ(cast(flat, {0, 0, 150, 0, 1, 0, 1000}), kNoHit);
  EXPECT_EQ(cast(flat, {0, 0, 150, 0, -1, 0, 49}), kNoHit) << "out of reach";
  EXPECT_NEAR(cast(flat, {0, 0, 150, 0, -1, 0, 50.0}), 50, 1e-5) << "just within";
  EXPECT_EQ(cast(flat, {0, 0, 99, 0, 1, 0, 1000}), 0) << "below the ground";
  EXPECT_EQ(cast(flat, {0, 0, 150, 0, -1, 0, 0}), kNoHit);
  EXPECT_EQ(cast(flat, {lattice::kMaxPosition, 0, 150, 1, -0.1, 0, 1000}), kNoHit) << "beyond the lattice is nothing";
}

TEST(Ground, ARayIsStoppedByTheFirstOfManyRidges) {
  const Made waves([](double x, double) { return 50 * std::sin(x / 20); });
  // Level at 40 m from a trough on: the first ridge is met where 50 sin(x / 20) = 40.
  const double first = 20 * std::asin(0.8);
  EXPECT_NEAR(cast(waves, {0, 0, 40, 1, 0, 0, 1e4}), first, 0.01);
  const double behind = 20 * (2 * std::numbers::pi + std::asin(0.8));
  EXPECT_NEAR(cast(waves, {static_cast<Step>(256 * 20 * 3), 0, 40, 1, 0, 0, 1e4}), behind - 60, 0.01);
}

// An oracle that shares nothing with the search: tiny equal steps, one height at a time.
TEST(Ground, AgreesWithASlowMarchOverRealTerrain) {
  std::mt19937 random(4);
  const auto uniform = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (const auto& description : terrain::builtIn()) {
    const auto terrain = terrain::create(description.name, 7).value();
    int hits = 0;
    for (int k = 0; k < 60; ++k) {
      Ray ray{static_cast<Step>(uniform(-1e6, 1e6)),
              static_cast<Step>(uniform(-1e6, 1e6)),
              0,
              uniform(-1, 1),
              uniform(-0.6, 0.1),
              uniform(-1, 1),
              300};
      ray.y = terrain->height({ray.x, ray.z}) + uniform(1, 80);
      const double length = std::hypot(ray.directionX, ray.directionY, ray.directionZ);
      double expected = kNoHit;
      for (double t = 0; t <= ray.reach; t += 0.02) {
        const lattice::Point at{ray.x + static_cast<Step>(std::llround(ray.directionX / length * t * 256)),
                                ray.z + static_cast<Step>(std::llround(ray.directionZ / length * t * 256))};
        if (ray.y + ray.directionY / length * t <= terrain->height(at)) {
          expected = t;
          break;
        }
      }
      const double found = cast(*terrain, ray);
      // What is pierced for less than a quarter of a metre may be missed.
      if (expected < 0 || (found > expected + 0.05 && found < expected + 2)) continue;
      EXPECT_NEAR(found, expected, 0.05) << description.name << " " << k;
      ++hits;
    }
    EXPECT_GT(hits, 20) << description.name;
  }
}

}  // namespace
}  // namespace ridgecast::ground
