// What is missing from a picture, and how far off the ground is, against pictures and geometry made by hand.
#include "client/evaluation/missing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace ridgecast::evaluation {
namespace {

constexpr std::uint32_t kWidth = 40, kHeight = 30;

render::Picture noisy(unsigned seed, int strength) {
  std::mt19937 random(7);
  std::mt19937 more(seed);
  render::Picture out{kWidth, kHeight, std::vector<std::uint8_t>(kWidth * kHeight * 3), std::vector<std::uint8_t>(kWidth * kHeight, 255)};
  for (std::size_t k = 0; k < out.rgb.size(); ++k) {
    const int value = 100 + static_cast<int>(random() % 60) + (strength ? static_cast<int>(more() % static_cast<unsigned>(strength)) : 0);
    out.rgb[k] = static_cast<std::uint8_t>(value);
  }
  return out;
}

// Ground 100 m away under every sample.
std::vector<float> ground(std::size_t samples) {
  std::vector<float> out(4 * kWidth * kHeight * samples * samples);
  for (std::size_t k = 0; k < out.size(); k += 4) {
    out[k + 1] = -100;
    out[k + 3] = 1;
  }
  return out;
}

TEST(Missing, ItsPartsAddUpWhateverThePicturesAre) {
  const render::Picture march = noisy(1, 0), mesh = noisy(2, 40), corrected = noisy(3, 10), finer = noisy(4, 4);
  const SimilarityMap a = similarityMap(mesh, march), b = similarityMap(corrected, march), c = similarityMap(finer, march);
  for (const std::size_t samples : {1u, 2u}) {
    std::vector<float> seen = ground(samples), marched = ground(samples);
    for (const std::size_t sky : {std::size_t{0}, std::size_t{500}}) {
      if (sky) seen[4 * sky + 3] = 0;
      const Missing m = missingOf(a, b, c, seen, marched, samples);
      EXPECT_NEAR(m.total, 1 - similarity(mesh, march).mean, 1e-12);
      EXPECT_NEAR(m.silhouettes + m.geometry + m.shading + m.marcher, m.total, 1e-12);
      EXPECT_GT(m.geometry, m.shading);
      EXPECT_GT(m.marcher, 0);
      EXPECT_EQ(m.windows > 0, sky > 0);
    }
  }
}

TEST(Missing, EqualPicturesMissNothing) {
  const render::Picture march = noisy(1, 0);
  const SimilarityMap same = similarityMap(march, march);
  const Missing m = missingOf(same, same, same, ground(1), ground(1), 1);
  EXPECT_NEAR(m.total, 0, 1e-12);
  EXPECT_EQ(m.windows, 0);
}

TEST(Missing, OnePixelOfOtherGroundMakesTheWindowsAroundItSilhouettes) {
  const SimilarityMap map = similarityMap(noisy(2, 40), noisy(1, 0));
  const double all = static_cast<double>(map.width * map.height);
  for (const auto& [at, windows] :
       std::vector<std::pair<std::size_t, double>>{{15 * kWidth + 20, 121}, {0, 1}, {kWidth * kHeight - 1, 1}}) {
    std::vector<float> seen = ground(1);
    seen[4 * at + 1] = -104;  // 4 % is nothing
    EXPECT_EQ(missingOf(map, map, map, seen, ground(1), 1).windows, 0);
    seen[4 * at + 1] = -106;
    const Missing m = missingOf(map, map, map, seen, ground(1), 1);
    EXPECT_NEAR(m.windows * all, windows, 1e-6);
    EXPECT_GT(m.silhouettes, 0);
  }
}

class Flat final : public terrain::Terrain {
 public:
  std::string_view name() const override { return "flat"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step>, std::span<const lattice::Step>, std::span<float> out) const override {
    for (float& h : out) h = 100;
  }
};

TEST(PixelError, IsWhatTheScreenShows) {
  camera::Camera camera;  // looks along -Z, at 150 m
  camera.pose.y = 150;
  camera.projection = {2 * std::atan(0.5), 800, 600};  // 600 pixels are as many metres at 600 m
  // Ground seen 200 m ahead, half a metre above the true one: 0.5 m at 200 m are 1.5 pixels. And sky, which does not count.
  const std::vector<float> seen = {0, -49.5f, -200, 1, 7, 7, 7, 0, 30, -50, -200, 1, 30, -50, -300, 1};
  const PixelError error = pixelErrorOf(seen, camera, Flat());
  EXPECT_EQ(error.samples, 3u);
  EXPECT_NEAR(error.worst, 1.5, 1e-6);
  EXPECT_NEAR(error.median, 0, 1e-6);
  EXPECT_EQ(pixelErrorOf(std::vector<float>{1, 1, 1, 0}, camera, Flat()).samples, 0u);
}

}  // namespace
}  // namespace ridgecast::evaluation
