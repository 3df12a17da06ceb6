// Height maps: the surface between samples against one computed another way, tiles on the wire, whatever comes for one.
#include "common/terrain/raster.h"
#include "common/terrain/variants.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <tuple>
#include <vector>

#include "common/terrain/shades.h"

namespace ridgecast::terrain {
namespace {

// Catmull-Rom from its definition: the cubic through p1 and p2 with slopes (p2 - p0) / 2 and (p3 - p1) / 2.
double curve(double p0, double p1, double p2, double p3, double t) {
  const double m1 = (p2 - p0) / 2, m2 = (p3 - p1) / 2;
  return (2 * t * t * t - 3 * t * t + 1) * p1 + (t * t * t - 2 * t * t + t) * m1 + (-2 * t * t * t + 3 * t * t) * p2 +
         (t * t * t - t * t) * m2;
}

TEST(Raster, theSurfaceIsTheCubicThroughItsSamples) {
  std::mt19937 random(1);
  for (int round = 0; round < 2000; ++round) {
    std::array<std::int32_t, 16> s;
    const std::int32_t base = static_cast<std::int32_t>(random() % 8'000'000) - 4'000'000;
    for (std::int32_t& v : s) v = base + static_cast<std::int32_t>(random() % 200'000);
    const RasterAxis axis{0, kMinPitch + random() * 64ull % (kMaxPitch - kMinPitch)};
    const auto pitch = static_cast<std::uint32_t>(axis.steps());
    const auto x = static_cast<float>(random() % pitch), z = static_cast<float>(random() % pitch);
    std::array<double, 4> rows;
    for (std::size_t j = 0; j < 4; ++j) rows[j] = curve(s[4 * j], s[4 * j + 1], s[4 * j + 2], s[4 * j + 3], x / axis.steps());
    const double expected = curve(rows[0], rows[1], rows[2], rows[3], z / axis.steps()) / 256;
    EXPECT_NEAR(cubicHeight(s, x, z, axis.inverse(), axis.inverse()), expected, 0.004);
    EXPECT_EQ(cubicHeight(s, 0, 0, axis.inverse(), axis.inverse()), static_cast<float>(s[5]) / 256);
  }
}

TEST(Bicubic, EveryVariantReturnsTheSameBitsForAnyNumberOfPlaces) {
  std::mt19937_64 random(5);
  for (const int bits : {4, 12, 24})
    for (const std::uint32_t pitch : {1u, 128u, 7680u}) {
      const float inverse = 1 / static_cast<float>(pitch);
      CubicPlaces places;
      for (std::size_t k = 0; k < CubicPlaces::kMax; ++k) {
        std::array<std::int32_t, 16> s;
        for (auto& v : s) v = static_cast<std::int32_t>(random() >> (64 - bits)) - (1 << (bits - 1));
        places.set(k, s, static_cast<float>(random() % pitch), static_cast<float>(random() % pitch));
      }
      std::array<float, CubicPlaces::kMax> expected{};
      for (std::size_t k = 0; k < expected.size(); ++k) {
        std::array<std::int32_t, 16> s;
        for (std::size_t i = 0; i < s.size(); ++i) s[i] = places.samples[i][k];
        expected[k] = cubicHeight(s, places.beyondX[k], places.beyondZ[k], inverse, inverse / 2);
      }
      for (const Variant& v : variants())
        for (int count = 0; count <= static_cast<int>(CubicPlaces::kMax); ++count) {
          std::array<float, CubicPlaces::kMax> out;
          out.fill(-7);
          v.cubicHeights(places, count, inverse, inverse / 2, out.data());
          for (std::size_t k = 0; k < out.size(); ++k)
            ASSERT_EQ(std::bit_cast<std::uint32_t>(out[k]), std::bit_cast<std::uint32_t>(static_cast<int>(k) < count ? expected[k] : -7.0f))
                << v.name << " " << k;
        }
    }
}

TEST(Extent, OfPlacesIsFoundByEveryVariant) {
  std::mt19937_64 random(6);
  for (const int bits : {3, 30, 51})
    for (std::size_t count = 1; count <= 40; ++count) {
      std::vector<lattice::Step> x(count), z(count);
      for (std::size_t k = 0; k < count; ++k) {
        x[k] = static_cast<lattice::Step>(random() >> (64 - bits)) - (lattice::Step{1} << (bits - 1));
        z[k] = static_cast<lattice::Step>(random() >> (64 - bits)) - (lattice::Step{1} << (bits - 1));
      }
      const auto [x0, x1] = std::ranges::minmax(x);
      const auto [z0, z1] = std::ranges::minmax(z);
      for (const Variant& v : variants()) {
        const Extent e = v.extentOf(x.data(), z.data(), count);
        ASSERT_EQ(std::tie(e.x0, e.z0, e.x1, e.z1), std::tie(x0, z0, x1, z1)) << v.name;
      }
    }
}

TEST(Raster, heightsKeepToTheBoundsThatAreTold) {
  std::mt19937 random(2);
  RasterShape shape{.width = 4, .height = 4, .lowest = -1000, .highest = 5000};
  const RasterBounds bounds = boundsOf(shape);
  for (int round = 0; round < 20'000; ++round) {
    std::array<std::int32_t, 16> s;
    for (std::int32_t& v : s) v = random() % 2 ? shape.lowest : shape.highest;
    const float h = cubicHeight(s, static_cast<float>(random() % 256), static_cast<float>(random() % 256), 1 / 256.0f, 1 / 256.0f);
    ASSERT_GE(h, bounds.lowest);
    ASSERT_LE(h, bounds.highest);
  }
}

TEST(Raster, CoordinatesFallBetweenSamplesOnBothSidesOfTheOrigin) {
  for (const Pitch pitch : {kMinPitch, pitchOf(7680), pitchOf(2637), kMaxPitch, pitchOf(25) + 629'146, kMinPitch + 1, kMaxPitch - 1}) {
    const RasterAxis axis{1000, pitch};
    const auto size = static_cast<lattice::Step>(axis.steps());
    for (lattice::Step v = -3 * size; v <= 3 * size; v += 1 + size / 64) {
      const Between b = axis.at(v + 1000);
      ASSERT_LT(b.parts, pitch);
      ASSERT_EQ(b.sample * static_cast<std::int64_t>(pitch) + static_cast<std::int64_t>(b.parts),
                v * static_cast<std::int64_t>(pitchOf(1)));
    }
    for (const std::int64_t sample : {0, -1, 1, 12'345'678, -12'345'678}) {
      const Between b = axis.at(axis.of(sample) + (axis.partsOf(sample) > 0));
      ASSERT_EQ(b.sample, sample) << "the first step behind it";
      ASSERT_LT(b.parts, pitchOf(1));
    }
  }
  EXPECT_EQ((RasterAxis{-lattice::kMaxPosition, kMinPitch}.at(lattice::kMaxPosition).sample), std::int64_t{1} << 47);
}

TEST(Raster, CoordinatesFallBetweenSamplesNearAndFar) {
  std::mt19937_64 random(8);
  for (const int bits : {20, 41, 42, 43, 46})
    for (int k = 0; k < 2000; ++k) {
      const RasterAxis axis{static_cast<lattice::Step>(random() % 1000), kMinPitch + random() % (kMaxPitch - kMinPitch)};
      const lattice::Step from = (random() % 2 == 0 ? 1 : -1) * ((lattice::Step{1} << bits) + static_cast<lattice::Step>(random() % 5) - 2);
      const Between b = axis.at(axis.origin + from);
      ASSERT_LT(b.parts, axis.pitch);
      ASSERT_TRUE(static_cast<__int128>(b.sample) * static_cast<std::int64_t>(axis.pitch) + static_cast<std::int64_t>(b.parts) ==
                  static_cast<__int128>(from) * static_cast<std::int64_t>(pitchOf(1)))
          << from << " of " << axis.pitch;
    }
}

std::unique_ptr<Tile> tileOf(const std::function<std::int32_t(int, int)>& height) {
  auto tile = std::make_unique<Tile>();
  for (int z = 0; z < kTileSide; ++z)
    for (int x = 0; x < kTileSide; ++x) (*tile)[static_cast<std::size_t>(z) * kTileSide + static_cast<std::size_t>(x)] = height(x, z);
  return tile;
}

TEST(RasterTile, comesBackAsItWas) {
  std::mt19937 random(3);
  const std::vector<std::unique_ptr<Tile>> tiles = [&] {
    std::vector<std::unique_ptr<Tile>> out;
    out.push_back(tileOf([](int, int) { return 0; }));
    out.push_back(tileOf([](int, int) { return -kMaxSample; }));
    out.push_back(tileOf([](int x, int z) { return 3 * x - 5 * z; }));
    out.push_back(tileOf([](int x, int z) { return (x + z) % 2 ? kMaxSample : -kMaxSample; }));
    out.push_back(tileOf([&](int, int) { return static_cast<std::int32_t>(random() % (2 * kMaxSample + 1)) - kMaxSample; }));
    out.push_back(tileOf([&](int x, int) { return x < 64 ? 100 : static_cast<std::int32_t>(random() % 50); }));
    return out;
  }();
  for (const auto& tile : tiles) {
    const auto bytes = encodeTile(*tile);
    EXPECT_LE(bytes.size(), kMaxTileBytes);
    const auto decoded = decodeTile(bytes);
    ASSERT_TRUE(decoded) << decoded.error().message;
    EXPECT_EQ(*decoded, *tile);
  }
  EXPECT_LT(encodeTile(*tiles[0]).size(), 8u);
  EXPECT_LT(encodeTile(*tiles[2]).size(), 1100u) << "a plane costs its edges";
}

TEST(RasterTile, whateverElseComesIsRefused) {
  std::mt19937 random(4);
  const auto tile = tileOf([&](int x, int z) { return 10 * x + static_cast<std::int32_t>(random() % 40) + z; });
  auto bytes = encodeTile(*tile);
  for (std::size_t n = 0; n < bytes.size(); n += 1 + n / 50) EXPECT_FALSE(decodeTile(std::span(bytes).first(n))) << n;
  bytes.push_back(0);
  EXPECT_FALSE(decodeTile(bytes));
  bytes.pop_back();
  bytes[0] = 0x31;
  EXPECT_FALSE(decodeTile(bytes));
  for (int round = 0; round < 300; ++round) {  // never reads or writes beyond; the sanitizers look
    std::vector<std::uint8_t> noise(random() % 60'000);
    for (std::uint8_t& b : noise) b = static_cast<std::uint8_t>(random());
    if (!noise.empty()) noise[0] = 0x30;
    if (const auto decoded = decodeTile(noise)) {
      for (const std::int32_t h : *decoded) ASSERT_LE(std::abs(h), kMaxSample);
    }
  }
}

TEST(Shades, normalsAndColoursSurviveTheirFiveBytes) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> any(-1, 1), unit(0, 1);
  for (int round = 0; round < 1000; ++round) {
    std::array<float, 3> n{any(random), 0.05f + unit(random), any(random)};
    const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (float& v : n) v /= length;
    const std::array<float, 3> c{unit(random), unit(random), unit(random)};
    const Shade s = makeShade(n, c);
    const float x = static_cast<float>(s.normalX) / 127, z = static_cast<float>(s.normalZ) / 127, p = x * x + z * z;
    EXPECT_NEAR(2 * x / (1 + p), n[0], 0.01);
    EXPECT_NEAR((1 - p) / (1 + p), n[1], 0.01);
    EXPECT_NEAR(2 * z / (1 + p), n[2], 0.01);
    EXPECT_NEAR(std::pow(static_cast<float>(s.red) / 255, 2), c[0], 0.005);
  }
  EXPECT_EQ(makeShade({NAN, NAN, NAN}, {NAN, -1, 7}), (Shade{0, 0, 0, 0, 255}));
}

TEST(Shades, ofABuiltInTerrainAreItsColoursAndSlopes) {
  const auto terrain = create("alpine", 1).value();
  ASSERT_TRUE(terrain->colours());
  std::vector<lattice::Step> x, z;
  for (lattice::Step k = 0; k < 200; ++k) x.push_back(k * 10'000), z.push_back(k * 7'000);
  std::vector<Shade> shades(x.size());
  shadesAt(*terrain, x, z, 0, shades);
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double dx = terrain->height({x[k] + 128, z[k]}) - terrain->height({x[k] - 128, z[k]});
    const float sx = static_cast<float>(shades[k].normalX);
    if (std::abs(dx) > 0.2) {
      EXPECT_LT(sx * static_cast<float>(dx), 0.0f) << "uphill the normal leans back";
    }
    EXPECT_GT(shades[k].red + shades[k].green + shades[k].blue, 30);
  }
}

}  // namespace
}  // namespace ridgecast::terrain
