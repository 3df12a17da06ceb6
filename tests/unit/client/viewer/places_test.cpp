// What is typed as a place, and where places of the world lie in the window.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "client/viewer/coordinates.h"
#include "client/viewer/leaf_colours.h"
#include "client/viewer/project.h"
#include "client/viewer/viewer_state.h"

namespace ridgecast::viewer {
namespace {

TEST(Coordinates, TakesNumbersOfAnySizeWithinTheLattice) {
  const auto steps = [](const char* text) {
    const auto parsed = parseMetres(text);
    EXPECT_TRUE(parsed) << text;
    return parsed ? *parsed : 0;
  };
  EXPECT_EQ(steps("0"), 0);
  EXPECT_EQ(steps(" -12.5 "), -3200);
  EXPECT_EQ(steps("+.25"), 64);
  EXPECT_EQ(steps("1_000_000_000_001"), 256'000'000'000'256);  // not to be had through a float
  EXPECT_EQ(steps("1e12"), 256'000'000'000'000);
  EXPECT_EQ(steps("-1.25E+1"), -3200);
  EXPECT_EQ(steps("2500e-3"), 640);
  EXPECT_EQ(steps("4398046511104"), lattice::kMaxPosition);
  EXPECT_EQ(steps("-4398046511104"), -lattice::kMaxPosition);
  for (const char* wrong : {"", "-", ".", "x", "1e99", "e3", "1e", "1e3e3", "1e13", "--1", "1.2.3", "4398046511105", "4398046511104.5",
                            "99999999999999999999999", "nan", "0x10", "1,5", "00000000000000000000000000000000000000000000000001"}) {
    const auto parsed = parseMetres(wrong);
    ASSERT_FALSE(parsed) << wrong;
    EXPECT_NE(parsed.error().message.find("4398046511104"), std::string::npos);
  }
}

TEST(Coordinates, SaysWhatItTakes) {
  std::mt19937_64 random(7);
  for (int k = 0; k < 2000; ++k) {
    const lattice::Step at = static_cast<lattice::Step>(random() % (2 * lattice::kMaxPosition)) - lattice::kMaxPosition;
    const auto parsed = parseMetres(formatMetres(at));
    ASSERT_TRUE(parsed);
    EXPECT_EQ(*parsed, at) << formatMetres(at);
  }
  EXPECT_EQ(formatMetres(-256), "-1");
  EXPECT_EQ(formatMetres(-1), "-0.004");
}

camera::Camera looking(double far, double yaw, double pitch) {
  camera::Camera camera;
  camera.pose.x = std::llround(far * 256);
  camera.pose.z = -camera.pose.x;
  camera.pose.y = 1000;
  camera.pose.yaw = yaw;
  camera.pose.pitch = pitch;
  return camera;
}

TEST(Projection, CentreCornersAndWhatIsBehind) {
  for (const double far : {0.0, 4e12}) {
    const camera::Camera camera = looking(far, 0.7, -0.4);
    const camera::Vec3 f = camera::forward(camera.pose), r = camera::right(camera.pose), u = camera::up(camera.pose);
    const auto centre = spotOf(camera, {f.x * 50, f.y * 50, f.z * 50});
    ASSERT_TRUE(centre);
    EXPECT_NEAR(centre->x, 0.5, 1e-9);
    EXPECT_NEAR(centre->y, 0.5, 1e-9);
    EXPECT_NEAR(centre->depth, 50, 1e-9);
    EXPECT_FALSE(spotOf(camera, {-f.x, -f.y, -f.z}));
    const double t = std::tan(camera.projection.verticalFov / 2), w = t * camera.projection.aspect();
    const auto corner = spotOf(camera, {f.x + w * r.x + t * u.x, f.y + w * r.y + t * u.y, f.z + w * r.z + t * u.z});
    ASSERT_TRUE(corner);
    EXPECT_NEAR(corner->x, 1, 1e-9);
    EXPECT_NEAR(corner->y, 0, 1e-9);
  }
}

TEST(Projection, LinesAreCutByTheWindowAndTheCamera) {
  const camera::Camera camera = looking(0, 0, 0);  // along -z
  const auto through = segmentOf(camera, {0, 0, 10}, {0, 0, -10});
  ASSERT_TRUE(through);
  EXPECT_GT(through->first.depth, 0);
  EXPECT_FALSE(segmentOf(camera, {-1, 0, 1}, {1, 0, 1}));
  EXPECT_FALSE(segmentOf(camera, {1000, 0, -1}, {1001, 0, -1}));
  const auto across = segmentOf(camera, {-1000, 0, -10}, {1000, 0, -10});
  ASSERT_TRUE(across);
  EXPECT_NEAR(across->first.x, 0, 1e-6);
  EXPECT_NEAR(across->second.x, 1, 1e-6);
  EXPECT_NEAR(across->first.y, 0.5, 1e-6);
}

TEST(Projection, AFrozenCamerasEdgesLieOnItsOwnFrame) {
  const camera::Camera seen = looking(1e12, 1.1, -0.3);
  for (const auto& [a, b] : frustumEdges(seen, seen.pose, 100)) {
    for (const camera::Vec3& end : {a, b}) {
      if (end.x == 0 && end.y == 0 && end.z == 0) continue;
      const auto spot = spotOf(seen, end);
      ASSERT_TRUE(spot);
      EXPECT_NEAR(std::abs(spot->x - 0.5), 0.5, 1e-9);
      EXPECT_NEAR(std::abs(spot->y - 0.5), 0.5, 1e-9);
      EXPECT_NEAR(spot->depth, 100, 1e-9);
    }
  }
}

double brightness(const Colour& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }

TEST(LeafColours, GrowDarkerStepByStep) {
  for (int level = 1; level <= lattice::kMaxLevel; ++level) EXPECT_LT(brightness(levelColour(level)), brightness(levelColour(level - 1)));
  for (double age = 1; age <= kOld; age *= 2) EXPECT_LT(brightness(ageColour(age)), brightness(ageColour(age / 2)));
  EXPECT_EQ(ageColour(kOld), ageColour(1e9));
}

TEST(LeafAges, CountFromTheLastChangeAndForgetWhatIsGone) {
  const lattice::LeafAddress a{0, 1, 2}, b{1, 3, 4};
  std::map<lattice::LeafAddress, core::HeldLeaf> leaves;
  leaves[a].version = 1;
  LeafAges ages;
  ages.update(leaves, 100);
  EXPECT_EQ(ages.age(a, 100), kOld);  // it may have been there for ever
  EXPECT_FALSE(ages.moving(100));
  leaves[a].version = 2;
  leaves[b].version = 2;
  ages.update(leaves, 110);
  EXPECT_EQ(ages.age(a, 113), 3);
  EXPECT_EQ(ages.age(b, 113), 3);
  EXPECT_TRUE(ages.moving(113));
  leaves[b].version = 3;
  ages.update(leaves, 120);
  EXPECT_EQ(ages.age(a, 121), 11);
  EXPECT_EQ(ages.age(b, 121), 1);
  leaves.erase(b);
  ages.update(leaves, 122);
  EXPECT_EQ(ages.age(b, 122), kOld);
}

TEST(History, KeepsTheLastValues) {
  History h;
  EXPECT_EQ(h.newest(), 0);
  for (std::size_t k = 0; k < History::kLength + 10; ++k) h.add(static_cast<double>(k));
  EXPECT_EQ(h.size(), History::kLength);
  EXPECT_EQ(h.at(0), 10);
  EXPECT_EQ(h.newest(), static_cast<float>(History::kLength + 9));
  EXPECT_EQ(h.most(), h.newest());
}

TEST(Building, NeverGoesBackBeforeItRests) {
  Building b;
  double before = 0;
  for (const std::uint64_t changes : {100, 1000, 800, 900, 400, 450, 20}) {
    b.iterated(changes, false);
    EXPECT_GE(b.share(), before);
    before = b.share();
  }
  EXPECT_NEAR(before, 0.98, 1e-9);
  b.iterated(0, true);
  EXPECT_EQ(b.share(), 1);
  b.iterated(500, false);
  EXPECT_EQ(b.share(), 0);
}

}  // namespace
}  // namespace ridgecast::viewer
