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

TEST(Controls, WalkingKeepsTheEyesAboveTheGroundAndLooksChangeNothing) {
  const auto slope = [](lattice::Point p) { return std::optional<double>(static_cast<double>(p.x) / 256 * 0.1); };
  camera::Pose start = at(100, 0);
  start.pitch = -1;
  Controls controls(start);
  controls.setWalking(true);
  EXPECT_DOUBLE_EQ(controls.speed(), 5);
  for (int k = 0; k < 60; ++k) controls.step({.right = 1, .up = 1}, 1.0 / 60, slope);
  EXPECT_NEAR(static_cast<double>(controls.pose().x) / 256, 105, 0.01);
  EXPECT_NEAR(controls.pose().y, 10.5 + kEyes, 0.01);
  for (int k = 0; k < 60; ++k) controls.step({.forward = 1}, 1.0 / 60, slope);
  EXPECT_NEAR(static_cast<double>(controls.pose().z) / 256, -5, 0.01);  // as far, however steep the look
}

TEST(Controls, LooksByKeysAndInvertsUpAndDown) {
  for (const bool invert : {false, true}) {
    Controls controls(at(0, 0));
    controls.setInvertY(invert);
    controls.step({.lookRight = 1, .lookUp = 1}, 0.5, kNoGround);
    EXPECT_NEAR(controls.pose().yaw, -kLook / 2, 1e-12);
    EXPECT_NEAR(controls.pose().pitch, invert ? -kLook / 2 : kLook / 2, 1e-12);
    const double before = controls.pose().pitch;
    controls.step({.turnY = 100}, 0.5, kNoGround);
    EXPECT_EQ(controls.pose().pitch < before, !invert);
  }
}

TEST(Sprint, LastsWhileHeldOrFromTapToTap) {
  Sprint held;
  EXPECT_TRUE(held.update(true, true, 0));
  EXPECT_TRUE(held.update(true, true, 1));
  EXPECT_FALSE(held.update(false, true, 1.1));
  Sprint tapped;
  EXPECT_TRUE(tapped.update(true, true, 0));
  EXPECT_TRUE(tapped.update(false, true, 0.1));
  EXPECT_TRUE(tapped.update(false, true, 60));
  EXPECT_TRUE(tapped.update(true, true, 61));  // the second tap ends it
  EXPECT_FALSE(tapped.update(false, true, 61.1));
  Sprint rests;
  rests.update(true, true, 0);
  EXPECT_TRUE(rests.update(false, true, 0.1));
  EXPECT_FALSE(rests.update(false, false, 1));
  EXPECT_FALSE(rests.update(false, true, 2));
}

TEST(Gamepad, RestsNearTheMiddleAndAddsToTheKeys) {
  EXPECT_EQ(stick(0.1f), 0);
  EXPECT_EQ(stick(-0.14f), 0);
  EXPECT_DOUBLE_EQ(stick(1), 1);
  EXPECT_DOUBLE_EQ(stick(-2), -1);
  EXPECT_EQ(stick(std::nanf("")), 0);
  EXPECT_LT(stick(0.3f), 0.05);
  Input input{.forward = 1};
  addGamepad(input, {0, -1, 1, -0.5f, -1, 1}, true, false, true, 0.5);  // forward, right and up
  EXPECT_EQ(input.forward, 1);
  EXPECT_EQ(input.lookRight, 1);
  EXPECT_GT(input.lookUp, 0.1);
  EXPECT_EQ(input.up, 1);
  EXPECT_TRUE(input.sprint);
  EXPECT_GT(input.wheel, 0);
  Input none;
  addGamepad(none, {0, 0, 0, 0, -1, -1}, false, false, false, 0.5);
  EXPECT_EQ(none.forward, 0);
  EXPECT_EQ(none.up, 0);
  EXPECT_EQ(none.wheel, 0);
}

}  // namespace
}  // namespace ridgecast::viewer
