// Procedural detail on a height map (--raster detail=): the formula of detail.h, written out once more in doubles.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using testing::HasSubstr;

constexpr int kWidth = 31, kHeight = 24;
double mapAt(int x, int z) { return 900 + 150 * std::sin(x * 0.4) * std::cos(z * 0.3) + x; }

class Detailing : public testing::Test {
 protected:
  Detailing() {
    std::ofstream out(file_, std::ios::binary);
    for (int z = 0; z < kHeight; ++z)
      for (int x = 0; x < kWidth; ++x) {
        const int v = static_cast<int>(std::lround(mapAt(x, z) * 16));
        out.put(static_cast<char>(v & 255)).put(static_cast<char>(v >> 8));
      }
  }
  Outcome<std::shared_ptr<const terrain::Terrain>> open(const std::vector<std::string>& more, const std::string& pitch = "30",
                                                        const MapLimits& limits = {}) const {
    RasterOptions o;
    std::vector<std::string> all{"size=31x24", "scale=0.0625", "pitch=" + pitch};
    all.insert(all.end(), more.begin(), more.end());
    for (const std::string& option : all) EXPECT_TRUE(addRasterOption(option, o)) << option;
    return loadRaster(file_, o, 5, limits);
  }
  process::Scratch scratch_ = process::Scratch::create().value();
  const std::filesystem::path file_ = scratch_.path() / "map.r16";
};

// Catmull-Rom along one axis.
double cubic(const std::array<double, 4>& p, double t) {
  return p[1] + 0.5 * t * (p[2] - p[0] + t * (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3] + t * (3 * (p[1] - p[2]) + p[3] - p[0])));
}
double bicubic(const std::function<double(std::int64_t, std::int64_t)>& at, double x, double z) {
  const auto i = static_cast<std::int64_t>(std::floor(x)), j = static_cast<std::int64_t>(std::floor(z));
  std::array<double, 4> rows;
  for (std::int64_t b = 0; b < 4; ++b) {
    std::array<double, 4> row;
    for (std::int64_t a = 0; a < 4; ++a) row[static_cast<std::size_t>(a)] = at(i - 1 + a, j - 1 + b);
    rows[static_cast<std::size_t>(b)] = cubic(row, x - static_cast<double>(i));
  }
  return cubic(rows, z - static_cast<double>(j));
}

TEST_F(Detailing, KeepsTheMapsOwnSamplesAndAddsWhatTheyCannotCarry) {
  for (const std::string edge : {"clamp", "mirror", "repeat", "700"}) {
    const auto plain = open({"edge=" + edge}).value(), detailed = open({"edge=" + edge, "detail=alpine:0.3"}).value();
    const auto alpine = terrain::create("alpine", 1).value();
    const terrain::RasterShape &coarse = plain->raster()->shape(), &fine = detailed->raster()->shape();
    ASSERT_EQ(fine.x.pitch, terrain::pitchOf(960));  // 30 m / 8
    EXPECT_EQ(fine.x.origin, coarse.x.origin);
    EXPECT_EQ(fine.width, edge == "repeat" ? 8 * kWidth : 8 * (kWidth - 1) + 1);
    EXPECT_NE(fine.content, coarse.content);
    const auto place = [](std::int64_t i, std::int64_t j, const terrain::RasterShape& of) {
      return lattice::Point{of.x.of(i), of.z.of(j)};
    };
    for (int j = 0; j < kHeight; ++j)
      for (int i = 0; i < kWidth; ++i)
        ASSERT_EQ(detailed->heightStep(place(i, j, coarse)), plain->heightStep(place(i, j, coarse))) << i << " " << j;
    const auto own = [&](std::int64_t i, std::int64_t j) { return static_cast<double>(plain->heightStep(place(i, j, coarse))); };
    const auto carried = [&](std::int64_t i, std::int64_t j) { return static_cast<double>(alpine->heightStep(place(i, j, coarse))); };
    double most = 0;
    for (std::uint32_t j = 0; j < fine.height; ++j)
      for (std::uint32_t i = 0; i < fine.width; ++i) {
        const lattice::Point p = place(i, j, fine);
        const double detail = alpine->heightStep(p) - bicubic(carried, i / 8.0, j / 8.0);
        ASSERT_NEAR(detailed->heightStep(p), bicubic(own, i / 8.0, j / 8.0) + 0.3 * detail, 0.6) << edge << " " << i << " " << j;
        most = std::max(most, std::abs(detail));
      }
    EXPECT_GT(most, 2 * 256) << "no detail to judge by";
  }
}

TEST_F(Detailing, GoesOnBeyondTheEdgeAsTheMapDoes) {
  const auto height = [&](const std::string& edge, double x, double z) {
    const auto terrain = open({"edge=" + edge, "detail=canyon:0.5:4"}).value();
    const terrain::RasterShape& shape = terrain->raster()->shape();
    return terrain->heightStep({shape.x.origin + std::llround(x * 7680), shape.z.origin + std::llround(z * 7680)});
  };
  EXPECT_EQ(height("repeat", 3.25, 5.5), height("repeat", 3.25 + kWidth, 5.5 - kHeight));
  EXPECT_EQ(height("mirror", 3.25, 5.5), height("mirror", -3.25, 2 * (kHeight - 1) - 5.5));
  EXPECT_EQ(height("clamp", 0, 5.5), height("clamp", -40, 5.5));
  EXPECT_EQ(height("700", -40, 5.5), 700 * 256);
}

TEST_F(Detailing, IsOfTheFactorAndTheTerrainAndSharedByWorldsOfAnySeed) {
  const std::vector<std::vector<std::string>> all{
      {}, {"detail=alpine:0.2"}, {"detail=alpine:0.4"}, {"detail=alpine:0.2:4"}, {"detail=canyon:0.2"}};
  std::set<std::uint64_t> contents;
  for (const auto& options : all) contents.insert(open(options).value()->raster()->shape().content);
  EXPECT_EQ(contents.size(), all.size());
  EXPECT_EQ(open({"detail=alpine:0.2"}).value()->raster()->shape().content,
            open({"detail=alpine:0.2:8"}).value()->raster()->shape().content);
  const auto a = open(all[1]).value();
  const std::uint64_t before = bytesOfMaps();
  const auto b = open(all[1]).value();
  EXPECT_EQ(bytesOfMaps(), before);
}

TEST_F(Detailing, SaysWhatDoesNotWork) {
  const auto why = [&](const std::vector<std::string>& options, const std::string& pitch = "30", const MapLimits& limits = {}) {
    const auto opened = open(options, pitch, limits);
    return opened ? "it was loaded" : opened.error().message;
  };
  EXPECT_THAT(why({"detail=alpine:0.2"}, "0.69921875"), HasSubstr("179 steps of 1/256 m apart, which 2 to 8 parts of at least 16"));
  EXPECT_THAT(why({"detail=alpine:0.2:7"}), HasSubstr("which 7 parts of at least 16"));
  EXPECT_THAT(why({"detail=alpine:0.2"}, "0.0625"), HasSubstr("parts of at least 16"));
  EXPECT_THAT(why({"detail=alpine:0.2"}, "30", {.total = 10'000}), HasSubstr("say fewer parts (detail=alpine:0.2:2)"));
  EXPECT_THAT(why({"detail=alpine:4", "offset=32500", "pitch=900"}),
              testing::AnyOf(HasSubstr("beyond 32,768 m"), HasSubstr("32,768 m of 0")));
  EXPECT_EQ(open({"detail=alpine:0.2"}, "0.75").value()->raster()->shape().x.pitch, terrain::pitchOf(24));  // 192 steps by 8
  for (const char* wrong :
       {"detail=", "detail=alpine", "detail=alpine:", "detail=alpine:0", "detail=alpine:-1", "detail=alpine:nan", "detail=alpine:5",
        "detail=mars:0.2", "detail=alpine:0.2:1", "detail=alpine:0.2:65", "detail=alpine:0.2:8:8", "detail=alpine:0.2:x"}) {
    RasterOptions o;
    const auto added = addRasterOption(wrong, o);
    ASSERT_FALSE(added) << wrong;
    EXPECT_THAT(added.error().message, HasSubstr("alpine, canyon, archipelago")) << wrong;
  }
}

}  // namespace
}  // namespace ridgecast::raster
