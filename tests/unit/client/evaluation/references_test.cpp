#include "client/evaluation/recorder.h"

#include <gtest/gtest.h>

namespace ridgecast::evaluation {
namespace {

References::March marchFrom(double y, std::uint32_t samples, bool unfiltered) {
  References::March out;
  out.camera.pose.y = y;
  out.samples = samples;
  out.milliseconds = y;
  if (unfiltered) out.unfiltered.emplace();
  return out;
}

camera::Camera cameraAt(double y) { return marchFrom(y, 1, false).camera; }

TEST(References, OnlyTheSamePictureIsTheSame) {
  References references(8);
  EXPECT_EQ(references.find(cameraAt(1), 1, false), nullptr);
  references.keep(marchFrom(1, 1, false));
  references.keep(marchFrom(2, 2, true));
  ASSERT_NE(references.find(cameraAt(1), 1, false), nullptr);
  EXPECT_EQ(references.find(cameraAt(1), 1, false)->milliseconds, 1);
  EXPECT_EQ(references.find(cameraAt(1), 1, true), nullptr);  // it was not drawn unfiltered
  EXPECT_EQ(references.find(cameraAt(1), 2, false), nullptr);
  EXPECT_NE(references.find(cameraAt(2), 2, true), nullptr);
  EXPECT_NE(references.find(cameraAt(2), 2, false), nullptr);
  camera::Camera smaller = cameraAt(1);
  smaller.projection.width /= 2;
  EXPECT_EQ(references.find(smaller, 1, false), nullptr);
  references.clear();
  EXPECT_EQ(references.find(cameraAt(1), 1, false), nullptr);
}

TEST(References, TheOldestGoFirst) {
  References references(2);
  for (const double y : {1.0, 2.0, 3.0}) references.keep(marchFrom(y, 1, false));
  EXPECT_EQ(references.find(cameraAt(1), 1, false), nullptr);
  EXPECT_NE(references.find(cameraAt(2), 1, false), nullptr);
  EXPECT_NE(references.find(cameraAt(3), 1, false), nullptr);
}

}  // namespace
}  // namespace ridgecast::evaluation
