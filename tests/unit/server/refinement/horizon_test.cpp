// What the horizon calls hidden against an oracle that walks along the line of sight over the true terrain.
#include "server/refinement/horizon.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"

namespace ridgecast::refinement {
namespace {

constexpr double kWide = 1.31, kPixel = 1.0 / 623;

camera::Camera above(const terrain::Terrain& terrain, double x, double z, double height, double yaw) {
  camera::Camera camera;
  camera.pose.x = static_cast<lattice::Step>(x * lattice::kStepsPerMetre);
  camera.pose.z = static_cast<lattice::Step>(z * lattice::kStepsPerMetre);
  camera.pose.y = terrain.height({camera.pose.x, camera.pose.z}) + height;
  camera.pose.yaw = yaw;
  return camera;
}

// By how much (a tangent) the ground before a point rises above the line of sight to it; negative: it is seen.
double covered(const terrain::Terrain& terrain, const camera::Camera& camera, const camera::Vec3& p) {
  const double flat = std::hypot(p.x, p.z), slope = p.y / flat;
  std::vector<double> r;
  std::vector<lattice::Step> x, z;
  for (double next = 8; next < flat * 0.97; next += std::max(0.5, 0.0005 * next)) {
    r.push_back(next);
    x.push_back(camera.pose.x + static_cast<lattice::Step>(p.x / flat * next * lattice::kStepsPerMetre));
    z.push_back(camera.pose.z + static_cast<lattice::Step>(p.z / flat * next * lattice::kStepsPerMetre));
  }
  std::vector<float> y(r.size());
  terrain.heights(x, z, y);
  double most = -1e9;
  for (std::size_t k = 0; k < r.size(); ++k) most = std::max(most, (y[k] - camera.pose.y) / r[k] - slope);
  return most;
}

struct Tally {
  int seen = 0, seenCalledHidden = 0, covered = 0, coveredCalledHidden = 0;
};

Tally tally(const terrain::Terrain& terrain, Horizon& horizon, const camera::Camera& camera, int points, unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  const camera::Vec3 ahead = camera::forward(camera.pose), right = camera::right(camera.pose);
  Tally t;
  for (int n = 0; n < points; ++n) {
    const double r = 100 * std::pow(100.0, unit(rng)), side = (unit(rng) - 0.5) * r;
    const lattice::Point at{camera.pose.x + static_cast<lattice::Step>((ahead.x * r + right.x * side) * lattice::kStepsPerMetre),
                            camera.pose.z + static_cast<lattice::Step>((ahead.z * r + right.z * side) * lattice::kStepsPerMetre)};
    const camera::Vec3 p{static_cast<double>(at.x - camera.pose.x) * lattice::kMetresPerStep, terrain.height(at) - camera.pose.y,
                         static_cast<double>(at.z - camera.pose.z) * lattice::kMetresPerStep};
    const double by = covered(terrain, camera, p);
    const bool hidden = horizon.hidden(p, 2 * kPixel);
    if (by < 0) ++t.seen, t.seenCalledHidden += hidden;
    if (by > 10 * kPixel) ++t.covered, t.coveredCalledHidden += hidden;
  }
  return t;
}

TEST(Horizon, HidesWhatTheGroundCoversAndHardlyAnythingElse) {
  for (const char* name : {"alpine", "canyon"}) {
    const auto terrain = terrain::create(name, 1).value();
    Tally sum;
    for (unsigned view = 0; view < 6; ++view) {
      const auto camera = above(*terrain, 900.0 * view, -700.0 * view, view % 2 ? 120 : 25, view);
      Horizon horizon(terrain);
      for (int ray : horizon.follow(camera, 25, 1, kWide)) horizon.cast(ray);
      const Tally t = tally(*terrain, horizon, camera, 400, view);
      sum.seen += t.seen, sum.seenCalledHidden += t.seenCalledHidden, sum.covered += t.covered,
          sum.coveredCalledHidden += t.coveredCalledHidden;
    }
    ASSERT_GT(sum.seen, 200) << name;
    ASSERT_GT(sum.covered, 200) << name;
    EXPECT_LE(sum.seenCalledHidden, sum.seen / 100) << name;
    EXPECT_GE(sum.coveredCalledHidden, sum.covered * 8 / 10) << name << ": " << sum.coveredCalledHidden << " of " << sum.covered;
  }
}

// After edits it hides what a new one hides, and casts the rays over them alone.
TEST(Horizon, OtherGroundIsCastAgain) {
  const std::shared_ptr<const terrain::Terrain> base = terrain::create("alpine", 1).value();
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> unit(0, 1);
  std::size_t again = 0, all = 0;
  for (int n = 0; n < 20; ++n) {
    auto camera = above(*base, 900.0 * n, -700.0 * n, 60, n);
    Horizon kept(base), fresh(base);
    for (int ray : kept.follow(camera, 60, 0, kWide)) kept.cast(ray);
    edits::History history(base);
    std::vector<lattice::Area> changed;
    for (int k = 0; k < 3; ++k) {
      const double turn = n + 4 * unit(rng), r = 300 * std::pow(30.0, unit(rng));
      const lattice::Point at{camera.pose.x - static_cast<lattice::Step>(256 * r * std::sin(turn)),
                              camera.pose.z - static_cast<lattice::Step>(256 * r * std::cos(turn))};
      changed.push_back(edits::groundOf(history.add({edits::Raise{at, 256 * 60, 0, 256 * 100}, 0}).value()));
    }
    const auto edited = std::make_shared<const edits::EditedTerrain>(base, history.layer());
    kept.setTerrain(edited, changed);
    fresh = Horizon(edited);
    const std::size_t rays = fresh.follow(camera, 60, 0, kWide).size();
    again += kept.follow(camera, 60, 0, kWide).size();
    all += rays;
    for (int ray : kept.follow(camera, 60, 0, kWide)) kept.cast(ray);
    for (int ray : fresh.follow(camera, 60, 0, kWide)) fresh.cast(ray);
    const camera::Vec3 ahead = camera::forward(camera.pose), right = camera::right(camera.pose);
    int hidden = 0;
    for (int k = 0; k < 1000; ++k) {
      const double r = 20 * std::pow(500.0, unit(rng)), side = (unit(rng) - 0.5) * r;
      const camera::Vec3 p{ahead.x * r + right.x * side, -60 - 200 * unit(rng), ahead.z * r + right.z * side};
      hidden += fresh.hidden(p, 0);
      ASSERT_EQ(kept.hidden(p, 0), fresh.hidden(p, 0)) << p.x << ", " << p.y << ", " << p.z;
    }
    EXPECT_GT(hidden, 0);
    camera.pose.x += 256;
    EXPECT_GE(kept.follow(camera, 60, 0, kWide).size(), rays) << "the eye is elsewhere";
  }
  EXPECT_GT(again, 0u);
  EXPECT_LT(again, all / 2);
}

TEST(Horizon, CastsOnlyWhatIsMissing) {
  const auto terrain = terrain::create("alpine", 1).value();
  Horizon horizon(terrain);
  auto camera = above(*terrain, 0, 0, 100, 0);
  EXPECT_FALSE(horizon.hidden({1000, -500, 0}, 0)) << "nothing was cast";
  const auto first = horizon.follow(camera, 100, 1, kWide);
  EXPECT_GT(first.size(), Horizon::kRays / 6);
  EXPECT_LT(first.size(), Horizon::kRays / 2);
  for (int ray : first) horizon.cast(ray);
  EXPECT_TRUE(horizon.follow(camera, 100, 1, kWide).empty());
  camera.pose.yaw += 0.1;
  const std::size_t turned = horizon.follow(camera, 100, 1, kWide).size();
  EXPECT_GT(turned, 0u);
  EXPECT_LT(turned, 30u);
  camera.pose.yaw -= 0.1;
  camera.pose.x += 5 * 256;
  EXPECT_TRUE(horizon.follow(camera, 100, 1, kWide).empty()) << "it has hardly moved";
  EXPECT_GE(Horizon(horizon).follow(camera, 100, 0, kWide).size(), first.size()) << "at rest the rays start from the eye";
  camera.pose.x += 30 * 256;
  EXPECT_GE(horizon.follow(camera, 100, 1, kWide).size(), first.size());
  camera.pose.pitch = -std::numbers::pi / 2;
  EXPECT_EQ(horizon.follow(camera, 100, 1, kWide).size(), static_cast<std::size_t>(Horizon::kRays)) << "straight down is all round";
}

}  // namespace
}  // namespace ridgecast::refinement
