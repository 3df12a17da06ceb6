// Laws of structural similarity, and an oracle that follows the paper's formula window by window.
#include "client/evaluation/ssim.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace ridgecast::evaluation {
namespace {

using render::Picture;

// Smooth blobs with noise of some strength: nothing flat, nothing random all over.
Picture blobs(std::uint32_t width, std::uint32_t height, unsigned seed, double strength) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  Picture p{width, height, {}, {}};
  for (std::uint32_t y = 0; y < height; ++y)
    for (std::uint32_t x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        const double v = 128 + 80 * std::sin(x * 0.21 + c) * std::cos(y * 0.13) + strength * noise(random);
        p.rgb.push_back(static_cast<std::uint8_t>(std::lround(std::clamp(v, 0.0, 255.0))));
      }
  p.terrain.assign(std::size_t{width} * height, 255);
  return p;
}

double luma(const Picture& p, std::size_t x, std::size_t y) {
  const std::uint8_t* rgb = &p.rgb[3 * (y * p.width + x)];
  return 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
}

// One window, two passes, straight from the paper: weighted means, then weighted central moments.
double slowWindow(const Picture& a, const Picture& b, std::size_t left, std::size_t top) {
  double norm = 0, ma = 0, mb = 0;
  const auto weight = [](std::size_t u, std::size_t v) {
    const double dx = static_cast<double>(u) - 5, dy = static_cast<double>(v) - 5;
    return std::exp(-(dx * dx + dy * dy) / 4.5);
  };
  for (std::size_t v = 0; v < 11; ++v)
    for (std::size_t u = 0; u < 11; ++u) {
      norm += weight(u, v);
      ma += weight(u, v) * luma(a, left + u, top + v);
      mb += weight(u, v) * luma(b, left + u, top + v);
    }
  ma /= norm;
  mb /= norm;
  double va = 0, vb = 0, cov = 0;
  for (std::size_t v = 0; v < 11; ++v)
    for (std::size_t u = 0; u < 11; ++u) {
      const double da = luma(a, left + u, top + v) - ma, db = luma(b, left + u, top + v) - mb, w = weight(u, v) / norm;
      va += w * da * da;
      vb += w * db * db;
      cov += w * da * db;
    }
  return (2 * ma * mb + 6.5025) * (2 * cov + 58.5225) / ((ma * ma + mb * mb + 6.5025) * (va + vb + 58.5225));
}

TEST(Ssim, EqualPicturesAreOne) {
  const Picture p = blobs(40, 30, 1, 20);
  EXPECT_NEAR(similarity(p, p).mean, 1, 1e-12);
  EXPECT_NEAR(similarity(p, p).terrain.value(), 1, 1e-12);
  EXPECT_DOUBLE_EQ(similarity(p, p).terrainShare, 1);
}

TEST(Ssim, IsSymmetricAndFallsWithNoise) {
  const Picture p = blobs(60, 50, 1, 0);
  double before = 1;
  for (const double strength : {2.0, 8.0, 30.0, 90.0}) {
    const Picture q = blobs(60, 50, 2, strength);
    const double s = similarity(p, q).mean;
    EXPECT_NEAR(s, similarity(q, p).mean, 1e-12);
    EXPECT_LT(s, before);
    before = s;
  }
}

TEST(Ssim, FlatPicturesDifferByLuminanceAlone) {
  Picture a{20, 20, std::vector<std::uint8_t>(1200, 50), {}}, b{20, 20, std::vector<std::uint8_t>(1200, 100), {}};
  EXPECT_NEAR(similarity(a, b).mean, (2 * 50 * 100 + 6.5025) / (50 * 50 + 100 * 100 + 6.5025), 1e-9);
}

TEST(Ssim, AgreesWithTheFormulaWindowByWindow) {
  const Picture a = blobs(33, 27, 5, 10);
  Picture b = blobs(33, 27, 6, 25);
  // Sky in a corner and a single pixel of it in the middle.
  for (std::size_t y = 0; y < 6; ++y)
    for (std::size_t x = 0; x < 9; ++x) b.terrain[y * 33 + x] = 0;
  b.terrain[20 * 33 + 22] = 0;
  double total = 0, terrain = 0;
  int windows = 0, terrainWindows = 0;
  for (std::size_t top = 0; top + 11 <= 27; ++top)
    for (std::size_t left = 0; left + 11 <= 33; ++left) {
      const double s = slowWindow(a, b, left, top);
      total += s;
      ++windows;
      bool all = true;
      for (std::size_t v = 0; v < 11; ++v)
        for (std::size_t u = 0; u < 11; ++u) all = all && b.terrain[(top + v) * 33 + left + u] == 255;
      if (!all) continue;
      terrain += s;
      ++terrainWindows;
    }
  const Similarity s = similarity(a, b);
  EXPECT_NEAR(s.mean, total / windows, 1e-9);
  ASSERT_TRUE(s.terrain);
  EXPECT_NEAR(*s.terrain, terrain / terrainWindows, 1e-9);
  EXPECT_NEAR(s.terrainShare, (33 * 27 - 55) / (33.0 * 27), 1e-12);
}

TEST(Ssim, WithoutTerrainThereIsNoTerrainValue) {
  Picture a = blobs(20, 20, 1, 1);
  a.terrain.assign(a.terrain.size(), 0);
  EXPECT_FALSE(similarity(a, a).terrain);
  a.terrain.clear();
  EXPECT_FALSE(similarity(a, a).terrain);
}

}  // namespace
}  // namespace ridgecast::evaluation
