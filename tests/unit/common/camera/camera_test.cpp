// The camera's laws: directions, and the frustum against a projection matrix.
#include "common/camera/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace ridgecast::camera {
namespace {

using Random = std::mt19937_64;
double between(Random& random, double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
void expectNear(const Vec3& v, double x, double y, double z) {
  EXPECT_NEAR(v.x, x, 1e-12);
  EXPECT_NEAR(v.y, y, 1e-12);
  EXPECT_NEAR(v.z, z, 1e-12);
}
Pose looking(double yaw, double pitch) {
  Pose pose;
  pose.yaw = yaw;
  pose.pitch = pitch;
  return pose;
}
constexpr double kQuarter = std::numbers::pi / 2;

TEST(Camera, YawZeroLooksAlongMinusZ) {
  expectNear(forward(looking(0, 0)), 0, 0, -1);
  expectNear(right(looking(0, 0)), 1, 0, 0);
  expectNear(up(looking(0, 0)), 0, 1, 0);
}

TEST(Camera, PositiveYawTurnsLeft) {
  expectNear(forward(looking(kQuarter, 0)), -1, 0, 0);
  expectNear(right(looking(kQuarter, 0)), 0, 0, -1);
}

TEST(Camera, PositivePitchLooksUp) {
  expectNear(forward(looking(0, kQuarter)), 0, 1, 0);
  expectNear(up(looking(0, kQuarter)), 0, 0, 1);
  expectNear(forward(looking(0, -kQuarter)), 0, -1, 0);
}

TEST(Camera, AxesAreARightHandedFrame) {
  Random random(1);
  for (int k = 0; k < 1000; ++k) {
    const Pose pose = looking(between(random, -10, 10), between(random, -kQuarter, kQuarter));
    const Vec3 f = forward(pose), r = right(pose), u = up(pose);
    EXPECT_NEAR(dot(f, f), 1, 1e-12);
    EXPECT_NEAR(dot(r, r), 1, 1e-12);
    EXPECT_NEAR(dot(f, r), 0, 1e-12);
    expectNear(u, r.y * f.z - r.z * f.y, r.z * f.x - r.x * f.z, r.x * f.y - r.y * f.x);
  }
}

// An oracle that shares nothing with the planes: the usual OpenGL view and projection matrices, clip coordinates, |x|, |y| <= w.
struct Clip {
  double x, y, w;
};
Clip project(const Pose& pose, const Projection& projection, double widening, const Vec3& p) {
  // World to view: turn by -yaw about y, then by -pitch about x.
  const double cy = std::cos(-pose.yaw), sy = std::sin(-pose.yaw), cp = std::cos(-pose.pitch), sp = std::sin(-pose.pitch);
  const Vec3 turned{cy * p.x + sy * p.z, p.y, -sy * p.x + cy * p.z};
  const Vec3 view{turned.x, cp * turned.y - sp * turned.z, sp * turned.y + cp * turned.z};
  const double focal = 1 / (std::tan(projection.verticalFov / 2) * widening);
  return {focal / projection.aspect() * view.x, focal * view.y, -view.z};
}

TEST(Frustum, ContainsWhatAProjectionMatrixShows) {
  Random random(2);
  int inside = 0, outside = 0;
  for (int k = 0; k < 100; ++k) {
    const Pose pose = looking(between(random, -7, 7), between(random, -kQuarter, kQuarter));
    Projection projection;
    projection.verticalFov = between(random, 0.2, 2.5);
    projection.width = static_cast<std::uint32_t>(between(random, 1, 3000));
    projection.height = static_cast<std::uint32_t>(between(random, 1, 3000));
    const double widening = between(random, 0.5, 3);
    const Frustum frustum(pose, projection, widening);
    for (int n = 0; n < 1000; ++n) {
      const Vec3 p{between(random, -100, 100), between(random, -100, 100), between(random, -100, 100)};
      const Clip clip = project(pose, projection, widening, p);
      const double margin = std::min({clip.w - std::abs(clip.x), clip.w - std::abs(clip.y), clip.w});
      if (std::abs(margin) < 1e-6) continue;
      EXPECT_EQ(frustum.contains(p), margin > 0);
      ++(margin > 0 ? inside : outside);
    }
  }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(outside, 1000);
}

TEST(Frustum, MayIntersectNeverMissesABoxThatHoldsAVisiblePoint) {
  Random random(3);
  int visible = 0, culled = 0;
  for (int k = 0; k < 20'000; ++k) {
    const Pose pose = looking(between(random, -7, 7), between(random, -kQuarter, kQuarter));
    const Frustum frustum(pose, Projection{}, between(random, 1, 2));
    const Vec3 low{between(random, -100, 90), between(random, -100, 90), between(random, -100, 90)};
    const Vec3 high{low.x + between(random, 0, 50), low.y + between(random, 0, 50), low.z + between(random, 0, 50)};
    bool seen = false;
    for (int n = 0; n < 20 && !seen; ++n)
      seen = frustum.contains({between(random, low.x, high.x), between(random, low.y, high.y), between(random, low.z, high.z)});
    EXPECT_TRUE(!seen || frustum.mayIntersect(low, high));
    visible += seen;
    culled += !frustum.mayIntersect(low, high);
  }
  EXPECT_GT(visible, 1000);
  EXPECT_GT(culled, 5000);  // it is of use
}

// Against points of the triangle, and of what lies over and under it, tried one by one.
TEST(Frustum, MeetsATriangleExactlyWhereAPointOfItIsSeen) {
  Random random(5);
  int met = 0, seenAtNoCorner = 0, missed = 0, claimed = 0;
  for (int k = 0; k < 4'000; ++k) {
    const Frustum frustum(looking(between(random, -7, 7), between(random, -kQuarter, kQuarter)), Projection{}, between(random, 1, 2));
    std::array<Vec3, 3> corners;
    for (Vec3& c : corners) c = {between(random, -20, 20), between(random, -20, 20), between(random, -20, 20)};
    const double lift = k % 2 ? 0 : between(random, 0, 5);
    bool seen = false;
    for (int n = 0; n < 2'000 && !seen; ++n) {
      double a = between(random, 0, 1), b = between(random, 0, 1);
      if (a + b > 1) a = 1 - a, b = 1 - b;
      const auto mix = [&](double u, double v, double w) { return u + a * (v - u) + b * (w - u); };
      seen = frustum.contains({mix(corners[0].x, corners[1].x, corners[2].x),
                               mix(corners[0].y, corners[1].y, corners[2].y) + between(random, -lift, lift),
                               mix(corners[0].z, corners[1].z, corners[2].z)});
    }
    const bool meets = frustum.meets(corners, lift);
    EXPECT_TRUE(!seen || meets);
    met += seen;
    seenAtNoCorner += seen && lift == 0 && std::none_of(corners.begin(), corners.end(), [&](const Vec3& c) { return frustum.contains(c); });
    missed += !meets;
    claimed += meets && !seen && lift == 0;
  }
  EXPECT_GT(met, 500);
  EXPECT_GT(seenAtNoCorner, 100);
  EXPECT_GT(missed, 500);
  EXPECT_LT(claimed, 40);  // slivers that no random point hit
}

TEST(Sector, MissesNothingThatIsSeenAtAnyHeight) {
  Random random(6);
  int seen = 0, missed = 0;
  for (int k = 0; k < 20'000; ++k) {
    const Pose pose = looking(between(random, -7, 7), between(random, -kQuarter, kQuarter));
    const Frustum frustum(pose, Projection{});
    const Sector sector(pose, Projection{});
    const Vec3 at{between(random, -100, 100), between(random, -300, 300), between(random, -100, 100)};
    const std::array<Vec3, 1> level{Vec3{at.x, 0, at.z}};
    EXPECT_TRUE(!frustum.contains(at) || !sector.misses(level));
    seen += frustum.contains(at);
    missed += sector.misses(level);
  }
  EXPECT_GT(seen, 1000);
  EXPECT_GT(missed, 5000);
}

TEST(Frustum, HoldsTheBoxAroundTheCamera) {
  Random random(4);
  for (int k = 0; k < 100; ++k)
    EXPECT_TRUE(Frustum(looking(between(random, -7, 7), between(random, -kQuarter, kQuarter)), {}).mayIntersect({-1, -1, -1}, {1, 1, 1}));
}

TEST(Projection, PixelsPerRadian) {
  Projection projection;
  projection.verticalFov = kQuarter;  // tangent of the half is 1: half the picture's height
  projection.height = 720;
  EXPECT_NEAR(pixelsPerRadian(projection), 360, 1e-9);
}

TEST(Camera, Validity) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(isValid(Camera{}));
  const auto with = [](auto change) {
    Camera camera;
    change(camera);
    return isValid(camera);
  };
  EXPECT_TRUE(with([](Camera& c) { c.pose.x = lattice::kMaxPosition; }));
  EXPECT_FALSE(with([](Camera& c) { c.pose.x = lattice::kMaxPosition + 1; }));
  EXPECT_FALSE(with([](Camera& c) { c.pose.z = INT64_MIN; }));
  for (double bad : {nan, infinite, -infinite, 1.1e6, -1.1e6}) EXPECT_FALSE(with([&](Camera& c) { c.pose.y = bad; }));
  for (double bad : {nan, infinite, 2e6}) EXPECT_FALSE(with([&](Camera& c) { c.pose.yaw = bad; }));
  for (double bad : {nan, infinite, 1.6, -1.6}) EXPECT_FALSE(with([&](Camera& c) { c.pose.pitch = bad; }));
  for (double bad : {nan, infinite, 0.0, 3.1, -1.0}) EXPECT_FALSE(with([&](Camera& c) { c.projection.verticalFov = bad; }));
  for (std::uint32_t bad : {0u, 32769u, ~0u}) {
    EXPECT_FALSE(with([&](Camera& c) { c.projection.width = bad; }));
    EXPECT_FALSE(with([&](Camera& c) { c.projection.height = bad; }));
  }
}

}  // namespace
}  // namespace ridgecast::camera
