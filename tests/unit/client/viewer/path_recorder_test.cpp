#include "client/viewer/path_recorder.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>

namespace ridgecast::viewer {
namespace {

TEST(PathRecorder, whatWasFlownIsAPathThatCanBeFlown) {
  PathRecorder recorder("al\"pine", 7);
  camera::Pose pose;
  pose.x = 256'000'000'000'123;
  pose.z = -77;
  pose.y = 1234.5;
  for (int k = 0; k < 100; ++k) {
    pose.x += 100;
    pose.yaw = 0.01 * k;
    pose.pitch = -0.2;
    recorder.add(1000 + 0.1 * k, pose);
  }
  EXPECT_EQ(recorder.keyframes(), 20u);
  const auto file = std::filesystem::temp_directory_path() / ("ridgecast-path-" + std::to_string(getpid()) + ".json");
  ASSERT_TRUE(recorder.write(file));
  const auto path = camera::readPath(file);
  std::filesystem::remove(file);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_EQ(path->terrain, "alpine");
  EXPECT_EQ(path->seed, 7u);
  ASSERT_EQ(path->keyframes.size(), 20u);
  EXPECT_EQ(path->keyframes[0].x, 256'000'000'000'223);
  EXPECT_EQ(path->keyframes[0].z, -77);
  EXPECT_NEAR(path->keyframes[19].t, 9.5, 0.01);
  EXPECT_NEAR(path->keyframes[19].pitch, -0.2, 1e-4);
  EXPECT_FALSE(recorder.write("/nowhere/at/all.json"));
}

}  // namespace
}  // namespace ridgecast::viewer
