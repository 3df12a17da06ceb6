// What the ground of height maps is made of. Maps are written by libtiff; where a pixel lies is computed here from easting and northing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"
#include "common/terrain/materials.h"
#include "tests/unit/common/raster/geotiff.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using testing::ElementsAre;
using testing::HasSubstr;

class ClassesTest : public testing::Test {
 protected:
  // 30 x 20 samples 10 m apart; the classes lie within.
  void SetUp() override {
    Tiff map{.width = 30, .height = 20, .bands = 1, .bits = 16, .across = 10, .down = 10, .west = 500'000, .north = 4'600'150};
    map.sample = [](int x, int z, int) { return 300 + 5 * x + 3 * z; };
    write(map_, map);
  }
  // 40 x 30 pixels of 2.5 x 2 m, whose values are 10, 30, 50.
  static Tiff cover() {
    Tiff t{.width = 40, .height = 30, .bands = 1, .across = 2.5, .down = 2, .west = 500'050, .north = 4'600'100};
    t.sample = [](int x, int z, int) { return 10 + 20 * ((x * 7 + z * 13 + x * z) % 3); };
    return t;
  }
  Outcome<std::shared_ptr<const terrain::Terrain>> load(const Tiff& classes, const std::vector<std::string>& options,
                                                        const MapLimits& limits = {}) const {
    write(classes_, classes);
    RasterOptions o;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, o)) << option;
    o.classes = classes_;
    return loadRaster(map_, o, 1, limits);
  }
  std::string complaint(const Tiff& classes, const std::vector<std::string>& options = kNamed, const MapLimits& limits = {}) const {
    const auto made = load(classes, options, limits);
    return made ? "it was loaded" : made.error().message;
  }
  static std::string materialOn(const terrain::Terrain& terrain, double easting, double northing) {
    const terrain::RasterShape& shape = terrain.raster()->shape();
    const Step x = shape.x.origin + static_cast<Step>(std::floor((easting - 500'005) * 256 + 0.5)),
               z = shape.z.origin + static_cast<Step>(std::floor((4'600'145 - northing) * 256 + 0.5));
    std::uint8_t out = 99;
    terrain.materials({&x, 1}, {&z, 1}, {&out, 1});
    return std::string(terrain::materialName(out, terrain.ownMaterials()));
  }
  static inline const std::vector<std::string> kNamed{"class=10:forest", "class=30:grass", "class=50:mud"};
  const std::optional<process::Scratch> scratch_ = process::Scratch::create().value();
  const std::filesystem::path map_ = scratch_->path() / "map.tif", classes_ = scratch_->path() / "cover.tif";
};

TEST_F(ClassesTest, APlaceIsMadeOfWhatItsPixelSays) {
  const Tiff t = cover();
  const auto terrain = load(t, kNamed).value();
  EXPECT_THAT(terrain->ownMaterials(), ElementsAre("forest", "mud"));
  std::mt19937 random(3);
  const auto within = [&](double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); };
  for (int k = 0; k < 5000; ++k) {
    const double easting = within(499'900, 500'400), northing = within(4'599'900, 4'600'200);
    const double i = (easting - t.west) / t.across, j = (t.north - northing) / t.down;
    const auto isAtBorder = [](double v) { return std::abs(v - std::round(v)) < 0.01; };  // places are steps
    if (isAtBorder(i) || isAtBorder(j)) continue;
    const bool isThere = i >= 0 && j >= 0 && i < t.width && j < t.height;
    const char* const names[] = {"forest", "grass", "mud"};
    const int value = isThere ? t.sample(static_cast<int>(i), static_cast<int>(j), 0) : 0;
    ASSERT_EQ(materialOn(*terrain, easting, northing), isThere ? names[(value - 10) / 20] : "") << easting << " " << northing;
  }
}

TEST_F(ClassesTest, WhatHasNoNameIsToldAndOfNoMaterial) {
  Tiff t = cover();
  t.noData = "50";
  const auto terrain = load(t, {"class=10:forest"}).value();
  EXPECT_THAT(describe(*terrain->raster()),
              testing::ContainsRegex("classes of cover.tif, 40 x 30 pixels, 2.5 m wide, without a name: 30 \\([0-9]+ % of it\\)"));
  EXPECT_THAT(describe(*load(cover(), kNamed).value()->raster()), testing::EndsWith("classes of cover.tif, 40 x 30 pixels, 2.5 m wide"));
  EXPECT_THAT(complaint(cover(), {}), HasSubstr("cover.tif: say what its values stand for, --raster class=VALUE:NAME: it has 10, 30, 50"));
  EXPECT_THAT(complaint(cover(), {"class=11:forest"}), HasSubstr("it has 10, 30, 50"));
}

TEST_F(ClassesTest, WithoutACrsThereIsAPixelForEachSample) {
  Tiff t = cover();
  t.width = 30, t.height = 20, t.epsg = 0;
  EXPECT_THAT(complaint(t), HasSubstr("does not say in which CRS"));  // and lies elsewhere
  t.across = t.down = 10, t.west = 500'000, t.north = 4'600'150;
  const auto terrain = load(t, kNamed).value();
  EXPECT_EQ(materialOn(*terrain, 500'005, 4'600'145), "forest");
  EXPECT_EQ(materialOn(*terrain, 500'016, 4'600'145), "grass");
  t.width = 29;
  EXPECT_THAT(complaint(t), HasSubstr("29 x 20 pixels"));
}

TEST_F(ClassesTest, WrongOnesAreRefused) {
  Tiff t = cover();
  t.epsg = 25832;
  EXPECT_THAT(complaint(t), HasSubstr("EPSG:25832 and the height map in EPSG:32632"));
  t = cover();
  t.west = 600'000;
  EXPECT_THAT(complaint(t), HasSubstr("lies beside the height map: take a map of classes of eastings"));
  t = cover();
  t.bands = 3;
  EXPECT_THAT(complaint(t), HasSubstr("it has 3 bands; a map of classes has one"));
  EXPECT_THAT(complaint(cover(), kNamed, {.total = 2400 + 4000}), HasSubstr("the map of classes takes 1 MB, and 0 MB are left"));
  t = cover();
  t.bits = 16;
  t.sample = [](int x, int z, int) { return x + 40 * z; };
  EXPECT_THAT(complaint(t), HasSubstr("more than 256 of its values have no name"));
  t = cover();
  t.noData = "10";
  t.sample = [](int, int, int) { return 10; };
  EXPECT_THAT(complaint(t), HasSubstr("nothing in it but NoData"));
  RasterOptions o;
  EXPECT_TRUE(addRasterOption("class=1:forest", o));
  EXPECT_THAT(loadRaster(map_, o, 1).error().message, HasSubstr("what values of --classes FILE stand for"));
  for (const char* wrong : {"class=forest", "class=1:", "class=1.5:forest", "class=2:Forest", "class=2:a b", "class=1:mud"})
    EXPECT_FALSE(addRasterOption(wrong, o)) << wrong;
  for (std::size_t k = 1; k < terrain::kMaxOwnMaterials; ++k)
    EXPECT_TRUE(addRasterOption("class=" + std::to_string(100 + k) + ":m" + std::to_string(k), o));
  EXPECT_TRUE(addRasterOption("class=900:m5", o));
  EXPECT_TRUE(addRasterOption("class=901:rock", o));
  EXPECT_THAT(addRasterOption("class=902:one-more", o).error().message, HasSubstr("at most 64 names"));
}

TEST_F(ClassesTest, AreCountedAndMakeAnotherWorld) {
  const std::uint64_t before = bytesOfMaps();
  const auto one = load(cover(), kNamed).value();
  const auto hash = terrain::contentHash(*one);
  EXPECT_GE(bytesOfMaps() - before, 4u * (30 * 20 + 40 * 30));
  EXPECT_NE(terrain::contentHash(*loadRaster(map_, {}, 1).value()), hash);
  EXPECT_NE(terrain::contentHash(*load(cover(), {"class=10:forest", "class=30:grass", "class=50:swamp"}).value()), hash);
  EXPECT_EQ(terrain::contentHash(*load(cover(), kNamed, {.inMemory = 0}).value()), hash);
  const RasterOptions plain;
  EXPECT_NE(hash, terrain::contentHash(*loadRaster(map_, plain, 2).value()));
}

}  // namespace
}  // namespace ridgecast::raster
