#include "client/render/picture.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <random>

namespace ridgecast::render {
namespace {

Picture noise(std::uint32_t width, std::uint32_t height) {
  std::mt19937 random(3);
  Picture p{width, height, {}, {}};
  for (std::uint32_t k = 0; k < width * height * 3; ++k) p.rgb.push_back(static_cast<std::uint8_t>(random()));
  p.terrain.assign(std::size_t{width} * height, 255);
  return p;
}

TEST(Picture, DownsamplingIsTheRoundedMeanOfEachBlock) {
  Picture p = noise(6, 4);
  p.terrain[0] = 0;
  const Picture half = downsample(p, 2);
  ASSERT_EQ(half.width, 3u);
  ASSERT_EQ(half.height, 2u);
  for (std::size_t y = 0; y < 2; ++y)
    for (std::size_t x = 0; x < 3; ++x)
      for (std::size_t c = 0; c < 3; ++c) {
        const auto at = [&](std::size_t u, std::size_t v) { return p.rgb[3 * ((2 * y + v) * 6 + 2 * x + u) + c]; };
        const double mean = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0;
        EXPECT_NEAR(half.rgb[3 * (y * 3 + x) + c], mean, 0.5);
      }
  EXPECT_EQ(half.terrain[0], 0);  // one sample of sky makes no terrain pixel
  EXPECT_EQ(half.terrain[1], 255);
}

TEST(Picture, PngKeepsEveryByte) {
  const auto file = std::filesystem::temp_directory_path() / ("ridgecast-picture-" + std::to_string(getpid()) + ".png");
  const Picture p = noise(37, 21);
  ASSERT_TRUE(writePng(p, file));
  const auto back = readPng(file);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->width, p.width);
  EXPECT_EQ(back->height, p.height);
  EXPECT_EQ(back->rgb, p.rgb);
  std::filesystem::remove(file);
}

TEST(Picture, UnwritableAndUnreadableFilesAreNamed) {
  const auto written = writePng(noise(11, 11), "/no/such/folder/a.png");
  ASSERT_FALSE(written);
  EXPECT_NE(written.error().message.find("/no/such/folder/a.png"), std::string::npos);
  const auto read = readPng("/no/such/folder/a.png");
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("/no/such/folder/a.png"), std::string::npos);
}

}  // namespace
}  // namespace ridgecast::render
