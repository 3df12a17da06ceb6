// Keys and mouse move the camera the way the axes say.
#include "client/viewer/controls.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace ridgecast::viewer {
namespace {

const auto kNoGround = [](lattice::Point) { return std::optional<double>(); };

camera::Pose at(double x, double z) {
  camera::Pose pose;
  pose.x = std::llround(x * 256);
  pose.z = std::llround(z * 256);
  pose.y = 1000;
  return pose;
}

// Where a second of this input leads from there, in metres.
camera::Vec3 moved(const camera::Pose& from, const Input& input, int frames = 60) {
  Controls controls(from);
  for (int k = 0; k < frames; ++k) controls.step(input, 1.0 / frames, kNoGround);
  const camera::Pose& to = controls.pose();
  return {(static_cast<double>(to.x - from.x) + to.remainderX - from.remainderX) / 256, to.y - from.y,
          (static_cast<double>(to.z - from.z) + to.remainderZ - from.remainderZ) / 256};
}

void expectNear(const camera::Vec3& v, double x, double y, double z) {
  EXPECT_NEAR(v.x, x, 1e-6);
  EXPECT_NEAR(v.y, y, 1e-6);
  EXPECT_NEAR(v.z, z, 1e-6);
}

TEST(Controls, KeysMoveAlongTheAxesHereAndFarAway) {
  for (const double far : {0.0, 1e12, -4e12}) {
    camera::Pose north = at(far, -far);
    expectNear(moved(north, {.forward = 1}), 0, 0, -50);
    expectNear(moved(north, {.right = 1}), 50, 0, 0);
    expectNear(moved(north, {.up = -1}), 0, -50, 0);
    expectNear(moved(north, {.forward = -1, .sprint = true}), 0, 0, 250);
    camera::Pose west = north;
    west.yaw = std::numbers::pi / 2;
    expectNear(moved(west, {.forward = 1}), -50, 0, 0);
    camera::Pose up = north;
    up.pitch = std::numbers::pi / 6;
    expectNear(moved(up, {.forward = 1}), 0, 25, -50 * std::cos(std::numbers::pi / 6));
  }
}

TEST(Controls, ManySmallStepsLeadAsFarAsOneLargeOne) {
  // A thousandth of a lattice step a frame is not lost.
  Controls slow(at(1e12, 0));
  Input slower{.wheel = -100};
  slow.step(slower, 0, kNoGround);
  EXPECT_DOUBLE_EQ(slow.speed(), 1);
  const camera::Pose from = slow.pose();
  for (int k = 0; k < 256000; ++k) slow.step({.right = 1}, 1.0 / 256000, kNoGround);
  EXPECT_NEAR((static_cast<double>(slow.pose().x - from.x) + slow.pose().remainderX) / 256, 1, 1e-6);
  EXPECT_LT(slow.pose().remainderX, 1);
  EXPECT_GE(slow.pose().remainderX, 0);
}

TEST(Controls, TheMouseTurnsTheWayItMoves) {
  Controls controls(at(0, 0));
  controls.step({.turnX = 100, .turnY = -100}, 0, kNoGround);
  EXPECT_LT(controls.pose().yaw, 0);    // to the right
  EXPECT_GT(controls.pose().pitch, 0);  // up
  controls.step({.turnX = 0, .turnY = -1e6}, 0, kNoGround);
  EXPECT_LT(controls.pose().pitch, std::numbers::pi / 2);
}

TEST(Controls, StaysAboveGroundAndInsideTheWorld) {
  Controls controls(at(0, 0));
  controls.step({}, 0, [](lattice::Point) { return std::optional<double>(1234.0); });
  EXPECT_GE(controls.pose().y, 1236);
  Controls edge(at(4398046511100.0, 0));
  for (int k = 0; k < 100; ++k) edge.step({.right = 1, .sprint = true, .wheel = 10}, 1, kNoGround);
  EXPECT_TRUE(lattice::positionIsValid(edge.pose().x, edge.pose().z));
}

}  // namespace
}  // namespace ridgecast::viewer
