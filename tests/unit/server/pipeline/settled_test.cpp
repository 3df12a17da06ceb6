// A mesh that says it is settled keeps the threshold wherever one stands. Each named pose once did not.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "common/terrain/raster.h"
#include "server/pipeline/pipeline.h"
#include "tests/support/rays.h"

namespace ridgecast::pipeline {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

camera::Camera standing(const terrain::Terrain& terrain, double x, double z, double altitude, double yaw, double pitch) {
  camera::Camera c;
  c.pose.x = std::llround(x * 256);
  c.pose.z = std::llround(z * 256);
  c.pose.y = terrain.height({c.pose.x, c.pose.z}) + altitude;
  c.pose.yaw = yaw * kDegree;
  c.pose.pitch = pitch * kDegree;
  return c;
}

struct Rig {
  explicit Rig(std::shared_ptr<const terrain::Terrain> ground, double threshold = 1)
      : terrain(std::move(ground)), pipeline(terrain, granted(threshold), pool) {}
  static settings::Settings granted(double threshold) {
    settings::Settings asked;
    asked.metric = settings::Metric::kPixels;
    asked.threshold = threshold;
    asked.triangleBudget = 2'000'000;
    return grant(asked, {});
  }
  void settle(const camera::Camera& camera) {
    int n = 0;
    do pipeline.iterate(camera);
    while (!pipeline.settled() && ++n < 300);
    ASSERT_TRUE(pipeline.settled());
  }
  void expectKept(const camera::Camera& camera, double threshold, const std::string& where) const {
    const auto error = testing_support::errorOnScreen(pipeline, *terrain, camera, threshold, 96);
    EXPECT_LE(error.p99, 2 * threshold) << where << ": " << error.worst;
    EXPECT_LE(error.most, 8 * threshold) << where << ": " << error.worst;
  }
  scheduling::Executor executor{2};
  std::shared_ptr<scheduling::Pool> pool = executor.makePool(2);
  std::shared_ptr<const terrain::Terrain> terrain;
  Pipeline pipeline;
};

std::shared_ptr<const terrain::Terrain> built(const char* name) { return terrain::create(name, 7).value(); }

// Level ground with a fence 150 m high and 3 m wide along z = 0, flat steps 40 m high along x, and an abyss beyond z = -500.
class Fence : public terrain::Terrain {
 public:
  std::string_view name() const override { return "fence"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < x.size(); ++k) {
      const double at = static_cast<double>(z[k]) / 256, along = static_cast<double>(x[k]) / 256;
      const double fence = std::max(0.0, 1 - std::abs(at) / 1.5), step = std::floor(along / 300);
      out[k] = static_cast<float>(at < -500 ? -900 : 150 * std::sqrt(fence) + 40 * (step - 2 * std::floor(step / 2)));
    }
  }
};

TEST(Settled, KeepsTheThresholdNearTheGround) {
  const struct {
    const char* terrain;
    double x, altitude, pitch;
  } poses[] = {{"canyon", 1686, 30, -1.1}, {"canyon", 3061, 5, 5.7}, {"alpine", 1191, 10, 2.9}, {"canyon", 1000, 30, -1.1}};
  for (const auto& p : poses) {
    Rig rig(built(p.terrain));
    const auto camera = standing(*rig.terrain, p.x, 0, p.altitude, 17.2, p.pitch);
    rig.settle(camera);
    rig.expectKept(camera, 1, std::string(p.terrain) + " " + std::to_string(p.x));
  }
}

TEST(Settled, KeepsTheThresholdAtRandomPoses) {
  std::mt19937_64 random(11);
  const auto between = [&](double low, double high) { return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53; };
  for (const char* name : {"alpine", "canyon", "archipelago"})
    for (const double threshold : {1.0, 0.5})
      for (int k = 0; k < 2; ++k) {
        Rig rig(built(name), threshold);
        const auto camera = standing(*rig.terrain, between(-1e6, 1e6), between(-1e6, 1e6), std::exp(between(std::log(1.5), std::log(300))),
                                     between(0, 360), between(-60, 30));
        rig.settle(camera);
        rig.expectKept(camera, threshold, std::string(name) + " " + std::to_string(k));
      }
}

// Four points of a triangle miss it, and the mesh without it lies outside the picture.
// A thread that looks closely has other cameras waiting: it looks at a part in each iteration.
TEST(Settled, LooksCloselyPartByPart) {
  Rig rig(built("alpine"), 0.5);
  const auto camera = standing(*rig.terrain, 1191, 0, 300, 17.2, -0.3);
  std::uint64_t most = 0, all = 0;
  bool looks = false;
  for (int n = 0; n < 300 && !rig.pipeline.settled(); ++n) {
    const settings::IterationStats figures = rig.pipeline.iterate(camera);
    looks = looks || (n > 0 && figures.inserted + figures.removed == 0);
    if (!looks) continue;
    most = std::max(most, figures.heights);
    all += figures.heights;
  }
  EXPECT_TRUE(rig.pipeline.settled());
  EXPECT_GT(all, 1'000'000u);
  EXPECT_LT(most, all / 8);
}

TEST(Settled, SeesAFenceFromBelowFromAboveAndBehindTheGroundBeforeIt) {
  Rig rig(std::make_shared<Fence>());
  for (const auto& camera : {standing(*rig.terrain, 20, 600, 2, 0, 12), standing(*rig.terrain, 20, 600, 300, 0, -20),
                             standing(*rig.terrain, 20, 20, 5, 0, 60), standing(*rig.terrain, 320, -800, 950, 180, 2)}) {
    rig.settle(camera);
    rig.expectKept(camera, 1, std::to_string(camera.pose.z));
  }
}

// What falls asleep on the way, hidden or outside, is judged again when the camera rests, and when the picture becomes another.
TEST(Settled, KeepsTheThresholdWhereAFlightEndsAndWhereThePictureGrows) {
  Rig rig(built("alpine"));
  camera::Camera camera;
  for (int n = 0; n < 60; ++n) rig.pipeline.iterate(camera = standing(*rig.terrain, 3 * n, -4 * n, 4 + n, n, -5 + n * 0.2));
  rig.settle(camera);
  rig.expectKept(camera, 1, "after a flight");
  camera.projection.verticalFov = 0.2;
  rig.settle(camera);
  camera.projection.verticalFov = 1.5;
  rig.settle(camera);
  rig.expectKept(camera, 1, "a wider picture");
}

// The way flown once grew so large that short ways no longer counted beside it: 494 insertions where a fresh connection made 1,345.
TEST(Settled, ManyLongJumpsLeaveRefinementAsItWas) {
  Rig jumped(built("alpine")), fresh(built("alpine"));
  for (int n = 0; n < 200; ++n) jumped.pipeline.iterate(standing(*jumped.terrain, n % 2 ? 4e12 : -4e12, n, 100, 0, -10));
  for (int n = 0; n < 40; ++n) {
    const auto camera = standing(*fresh.terrain, 5 * n, 0, 60, 0, -10);
    const auto a = jumped.pipeline.iterate(camera), b = fresh.pipeline.iterate(camera);
    EXPECT_EQ(a.inserted, b.inserted) << n;
    EXPECT_EQ(a.triangles, b.triangles) << n;
  }
}

// A budget far too small for the picture: the mesh comes to rest, and does not claim an error that it does not keep.
TEST(Settled, TellsTheErrorThatABudgetLeaves) {
  settings::Settings asked;
  asked.metric = settings::Metric::kPixels;
  asked.threshold = 0.5;
  asked.triangleBudget = 20'000;
  Rig rig(built("canyon"));
  rig.pipeline.change(grant(asked, {}));
  const auto camera = standing(*rig.terrain, 1000, 0, 200, 0, -20);
  settings::IterationStats figures;
  for (int n = 0; n < 400 && !rig.pipeline.settled(); ++n) figures = rig.pipeline.iterate(camera);
  ASSERT_TRUE(rig.pipeline.settled());
  EXPECT_LE(figures.triangles, 20'000u);
  EXPECT_GT(figures.effectiveThreshold, 0.5);
  rig.expectKept(camera, figures.effectiveThreshold, "under a budget");
}

// A limit to insertions: what is told after each iteration holds for the mesh as it is then, though it is far from settled.
TEST(Settled, TellsTheErrorThatALimitLeaves) {
  Rig rig(built("alpine"), 0.6);
  rig.pipeline.setInsertionLimit(300);
  const auto camera = standing(*rig.terrain, 1000, 0, 120, 0, -10);
  for (int n = 0; n < 40; ++n) {
    const auto figures = rig.pipeline.iterate(camera);
    if (n < 5 || n % 12 != 0) continue;
    EXPECT_GT(figures.effectiveThreshold, 0.6);
    rig.expectKept(camera, figures.effectiveThreshold, "after " + std::to_string(n) + " limited iterations");
  }
}

}  // namespace
}  // namespace ridgecast::pipeline
