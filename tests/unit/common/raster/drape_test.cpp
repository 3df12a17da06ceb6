// Pictures on height maps. Map and picture are written by libtiff; where a pixel lies is computed here from easting and northing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <random>

#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"
#include "tests/unit/common/raster/geotiff.h"

namespace ridgecast::raster {
namespace {

using lattice::Step;
using testing::HasSubstr;
using Colour = std::array<float, 3>;

float linear(double byte) {
  const double v = byte / 255;
  return static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
}

class Drapes : public testing::Test {
 protected:
  // 30 x 20 samples; the picture lies within.
  void SetUp() override { write(map_, mapOf(10)); }
  static Tiff mapOf(double pitch) {
    Tiff map{.width = 30, .height = 20, .bands = 1, .bits = 16, .across = pitch, .down = pitch, .west = 500'000, .north = 4'600'150};
    map.sample = [](int x, int z, int) { return 300 + 5 * x + 3 * z; };
    return map;
  }
  std::filesystem::path file(const std::string& name) const { return scratch_->path() / name; }
  Outcome<std::shared_ptr<const terrain::Terrain>> loaded(const Tiff& picture, const std::vector<std::string>& options = {},
                                                          const MapLimits& limits = {}) const {
    write(picture_, picture);
    RasterOptions o;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, o)) << option;
    o.drape = picture_;
    return loadRaster(map_, o, 1, limits);
  }
  std::shared_ptr<const terrain::Terrain> load(const Tiff& picture, const std::vector<std::string>& options = {},
                                               const MapLimits& limits = {}) const {
    auto made = loaded(picture, options, limits);
    EXPECT_TRUE(made) << made.error().message;
    return made ? *made : nullptr;
  }
  std::string complaint(const Tiff& picture, const std::vector<std::string>& options = {}, const MapLimits& limits = {}) const {
    const auto made = loaded(picture, options, limits);
    return made ? "it was loaded" : made.error().message;
  }
  static Colour colourAt(const terrain::Terrain& terrain, Step x, Step z, float footprint = 0.01f) {
    const float height = 400;
    const Colour up{0, 1, 0};
    Colour out{};
    terrain.colours()(&x, &z, &height, &up, footprint, &out, 1, 1);
    return out;
  }
  // Of this easting and northing, from the map's own sample in the middle, by the file's pitch and the terrain's.
  static Colour colourOn(const terrain::Terrain& terrain, double pitch, double easting, double northing, float footprint = 0.01f) {
    const terrain::RasterShape& shape = terrain.raster()->shape();
    const auto steps = [&](double metres, const terrain::RasterAxis& axis) {
      return axis.origin + static_cast<Step>(std::llround(metres / pitch * axis.steps()));
    };
    return colourAt(terrain, steps(easting - (500'000 + pitch / 2), shape.x), steps(4'600'150 - pitch / 2 - northing, shape.z), footprint);
  }
  static void expectNear(const Colour& found, const Colour& wanted, double tolerance, const std::string& what) {
    for (std::size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[c], wanted[c], tolerance) << what << ", channel " << c;
  }

  std::optional<process::Scratch> scratch_ = process::Scratch::create().value();
  std::filesystem::path map_ = file("map.tif"), picture_ = file("ortho.tif");
};

// Middles of pixels have their colours, and between them colours are bilinear in linear light, wherever the file says that they lie.
TEST_F(Drapes, LieWhereTheirFileSays) {
  struct Case {
    std::string name;
    Tiff picture;
    std::vector<std::string> options = {};
    double pitch = 10;
  };
  Tiff points, oblong, shifted;
  points.pixelsArePoints = true;
  oblong.across = 0.4, oblong.down = 0.7;
  shifted.west = 500'010.13, shifted.north = 4'600'099.71;
  const std::vector<Case> cases = {{"by corners", {}},
                                   {"by middles", points},
                                   {"of oblong pixels", oblong},
                                   {"between the map's samples", shifted},
                                   {"at the map's place", shifted, {"place=geo"}},
                                   {"on a map with another pitch", shifted, {"pitch=3"}},
                                   {"on a map whose pitch is no whole step", shifted, {}, 10.0017}};
  std::mt19937 random(5);
  for (const Case& c : cases) {
    write(map_, mapOf(c.pitch));
    const auto terrain = load(c.picture, c.options);
    ASSERT_TRUE(terrain);
    const double half = c.picture.pixelsArePoints ? 0 : 0.5;
    for (int k = 0; k < 300; ++k) {
      const int i = 1 + static_cast<int>(random() % 117), j = 1 + static_cast<int>(random() % 87);
      const double u = k % 2 ? 0 : static_cast<double>(random() % 1000) / 1000, v = k % 2 ? 0 : static_cast<double>(random() % 1000) / 1000;
      Colour wanted{};
      for (int b = 0; b < 3; ++b) {
        const auto at = [&](int dx, int dz) { return linear(c.picture.sample(i + dx, j + dz, b)); };
        wanted[static_cast<std::size_t>(b)] =
            static_cast<float>((at(0, 0) * (1 - u) + at(1, 0) * u) * (1 - v) + (at(0, 1) * (1 - u) + at(1, 1) * u) * v);
      }
      const double easting = c.picture.west + (i + u + half) * c.picture.across,
                   northing = c.picture.north - (j + v + half) * c.picture.down;
      // A step is up to 0.0131 of these pixels (at pitch=3), and pixels differ by up to 1 along each axis.
      expectNear(colourOn(*terrain, c.pitch, easting, northing), wanted, 0.03, c.name);
    }
  }
}

TEST_F(Drapes, EveryFormGivesTheSameColours) {
  const auto plain = load({});
  const auto wide = [](int x, int z, int band) { return 257 * Tiff().sample(x, z, band); };
  Tiff deep{.bits = 16, .sample = wide}, deepTiles{.bits = 16, .packing = COMPRESSION_LZW, .tiled = true, .sample = wide};
  Tiff four{.bands = 4}, infrared{.bands = 4, .alpha = EXTRASAMPLE_UNSPECIFIED};
  four.sample = [](int x, int z, int band) { return band == 3 ? 255 : Tiff().sample(x, z, band); };
  for (const Tiff& form : {deep, deepTiles, four, infrared, Tiff{.packing = COMPRESSION_ADOBE_DEFLATE, .tiled = true}}) {
    const auto other = load(form);
    for (Step k = 0; k < 200; ++k) {
      const double easting = 500'012 + 0.27 * static_cast<double>(k), northing = 4'600'098 - 0.19 * static_cast<double>(k);
      EXPECT_EQ(colourOn(*other, 10, easting, northing), colourOn(*plain, 10, easting, northing));
    }
  }
  const Tiff jpeg{.packing = COMPRESSION_JPEG, .tiled = true, .sample = [](int x, int, int band) { return x + 40 * band; }};
  const auto packed = load(jpeg);
  for (int k = 10; k < 110; ++k)
    expectNear(colourOn(*packed, 10, 500'010 + (k + 0.5) / 2, 4'600'080.25), {linear(k), linear(k + 40), linear(k + 80)}, 0.02, "JPEG");
}

// What a wide sample sees is the mean of light, not of bytes: half of white is not 128.
TEST_F(Drapes, WideFootprintsSeeTheMeanLight) {
  const Tiff board{.width = 128, .height = 128, .sample = [](int x, int z, int) { return (x + z) % 2 * 255; }};
  const auto terrain = load(board);
  for (const float footprint : {1.0f, 1.7f, 4.0f, 8.0f})
    expectNear(colourOn(*terrain, 10, 500'041.3, 4'600'069.2, footprint), {0.5f, 0.5f, 0.5f}, 0.005, std::to_string(footprint));
  // Of a random picture: the mean of the pixels below a sample in the middle of 16 x 16 of them.
  std::mt19937 random(9);
  std::vector<int> bytes(std::size_t{128} * 128 * 3);
  for (int& v : bytes) v = static_cast<int>(random() % 256);
  const auto sample = [&](int x, int z, int band) {
    return bytes[(static_cast<std::size_t>(z) * 128 + static_cast<std::size_t>(x)) * 3 + static_cast<std::size_t>(band)];
  };
  const auto noise = load({.width = 128, .height = 128, .sample = sample});
  for (int k = 1; k < 7; ++k) {
    Colour wanted{};
    for (int p = 0; p < 256; ++p)
      for (int b = 0; b < 3; ++b) wanted[static_cast<std::size_t>(b)] += linear(sample(16 * k + p % 16, 32 + p / 16, b)) / 256;
    expectNear(colourOn(*noise, 10, 500'010 + 8.0 * k + 4, 4'600'100 - 20, 8), wanted, 0.006, "block " + std::to_string(k));
  }
}

TEST_F(Drapes, OutsideAndWhereTransparentTheMapHasItsOwnColours) {
  const auto plain = loadRaster(map_, {}, 1).value();
  const auto same = [&](const terrain::Terrain& terrain, double easting, double northing) {
    return colourOn(terrain, 10, easting, northing) == colourOn(*plain, 10, easting, northing);
  };
  Tiff holes{.bands = 4}, none{.noData = "7"};
  const auto isHole = [](int x, int z) { return x >= 40 && x < 60 && z >= 30 && z < 50; };
  holes.sample = [&](int x, int z, int band) { return band == 3 ? (isHole(x, z) ? 0 : 255) : Tiff().sample(x, z, band); };
  none.sample = [&](int x, int z, int band) { return isHole(x, z) ? 7 : Tiff().sample(x, z, band); };
  for (const Tiff& picture : {holes, none}) {
    const auto terrain = load(picture);
    EXPECT_TRUE(same(*terrain, 500'010 + 25, 4'600'100 - 20));    // in the hole
    EXPECT_FALSE(same(*terrain, 500'010 + 25, 4'600'100 - 14));   // before it
    EXPECT_FALSE(same(*terrain, 500'010 + 0.3, 4'600'100 - 20));  // at the picture's side
    EXPECT_TRUE(same(*terrain, 500'010 - 0.3, 4'600'100 - 20));
    EXPECT_TRUE(same(*terrain, 500'010 + 60.3, 4'600'100 - 20));
    EXPECT_TRUE(same(*terrain, 1e9, -1e9));
    EXPECT_EQ(colourAt(*terrain, lattice::kMaxPosition, -lattice::kMaxPosition, 1e9f),
              colourAt(*plain, lattice::kMaxPosition, -lattice::kMaxPosition, 1e9f));
  }
  EXPECT_EQ(plain->height({0, 0}), load({})->height({0, 0}));
}

// Where pixels are samples, tiles have the picture's own bytes.
TEST_F(Drapes, TilesHaveThePicturesColours) {
  Tiff picture{.width = 20, .height = 20, .bands = 4, .across = 10, .down = 10, .west = 500'000, .north = 4'600'150};
  picture.sample = [](int x, int z, int band) { return band == 3 ? (x == 3 ? 0 : 255) : Tiff().sample(x, z, band); };
  const auto terrain = load(picture, {"edge=repeat"});
  const terrain::Raster& raster = *terrain->raster();
  EXPECT_TRUE(raster.shape().draped);
  EXPECT_FALSE(loadRaster(map_, {}, 1).value()->raster()->shape().draped);
  const auto tile = raster.tileColours({0, 0});
  ASSERT_EQ(tile.size(), terrain::kTileColourBytes);
  for (int z = 0; z < terrain::kTileSide; ++z)
    for (int x = 0; x < terrain::kTileSide; ++x)
      for (int band = 0; band < 4; ++band)
        ASSERT_EQ(tile[static_cast<std::size_t>(4 * (z * terrain::kTileSide + x) + band)],
                  x < 20 && z < 20 && x != 3 ? picture.sample(x, z, band) : 0)
            << x << ", " << z;
  EXPECT_TRUE(raster.tileColours({-1, 0}).empty());
  EXPECT_TRUE(raster.tileColours({0, 5'000'000}).empty());
}

// gdaldem color-relief's text: mixed between heights, and as they are beyond them. Also on a map that does not say where it lies.
TEST_F(Drapes, ARampColoursByHeight) {
  const auto ramp = file("ramp.txt");
  const auto made = [&](const std::string& text) {
    std::ofstream(ramp) << text;
    RasterOptions o;
    o.drape = ramp;
    return loadRaster(map_, o, 1, {});
  };
  Tiff map = mapOf(10);
  map.epsg = 0;
  write(map_, map);
  const auto terrain = made("# metres, red, green, blue\n400 200,100,50\r\n\n350:0:0:255 # low\n460\t10 20 30 128\n");
  ASSERT_TRUE(terrain) << terrain.error().message;
  const terrain::RasterShape& shape = (*terrain)->raster()->shape();
  EXPECT_TRUE(shape.draped);
  const auto own = loadRaster(map_, {}, 1, {});
  for (int x = 0; x < 30; ++x)
    for (int z = 0; z < 20; ++z) {
      const double height = 300 + 5 * x + 3 * z;
      std::array<double, 4> wanted{0, 0, 255, 255};
      const std::array<double, 4> middle{200, 100, 50, 255}, high{10, 20, 30, 128};
      const double t = std::clamp((height - 350) / 50, 0.0, 1.0), u = std::clamp((height - 400) / 60, 0.0, 1.0);
      for (std::size_t c = 0; c < 4; ++c)
        wanted[c] = height < 400 ? wanted[c] + t * (middle[c] - wanted[c]) : middle[c] + u * (high[c] - middle[c]);
      const Step sx = shape.x.of(x), sz = shape.z.of(z);
      const Colour plain = colourAt(**own, sx, sz), found = colourAt(**terrain, sx, sz);
      for (std::size_t c = 0; c < 3; ++c) {
        const double alpha = wanted[3] / 255;
        EXPECT_NEAR(found[c], alpha * linear(wanted[c]) + (1 - alpha) * plain[c], 0.012) << height << ", channel " << c;
      }
    }
  const auto step = made("0 255 0 0\n401 255 0 0\n401 0 0 255\n");
  expectNear(colourAt(**step, shape.x.of(20), shape.z.of(0)), {1, 0, 0}, 1e-3, "below the step");
  expectNear(colourAt(**step, shape.x.of(21), shape.z.of(0)), {0, 0, 1}, 1e-3, "above it");
  for (const auto& [text, sentence] :
       std::vector<std::pair<std::string, std::string>>{{"", "there is no line HEIGHT RED GREEN BLUE"},
                                                        {"0 1 2 3\n5 red", "line 2: 'red' is no number; a line of a colour ramp is"},
                                                        {"0 1 2", "there are 3 numbers"},
                                                        {"0 1 2 256", "a colour is not within 0 to 255"},
                                                        {"nan 1 2 3", "is no number"},
                                                        {"50% 1 2 3", "'50%' is no number"},
                                                        {std::string(2 << 20, ' '), "longer than 1 MiB"}}) {
    const auto refused = made(text);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, HasSubstr(sentence));
  }
}

TEST_F(Drapes, WrongOnesAreRefused) {
  EXPECT_THAT(complaint({.epsg = 25832}), HasSubstr("EPSG:25832 and the height map in EPSG:32632: warp it (gdalwarp -t_srs EPSG:32632)"));
  EXPECT_THAT(complaint({.epsg = 0}), HasSubstr("does not say where it lies"));
  EXPECT_THAT(complaint({.across = 0}), HasSubstr("its pixels are 0 x 0.5 m wide"));
  EXPECT_THAT(complaint({.west = 600'000}), HasSubstr("beside the height map: take a picture of eastings 500005 to 500295"));
  EXPECT_THAT(complaint({.bands = 1}), HasSubstr("it has 1 bands of 8 bits; a picture has red, green, blue"));
  EXPECT_THAT(complaint({.order = PLANARCONFIG_SEPARATE}), HasSubstr("INTERLEAVE=PIXEL"));
  EXPECT_THAT(complaint({}, {}, {.total = 2400 + 57'000}), HasSubstr("the picture takes 1 MB, and 0 MB are left"));
  EXPECT_THAT(complaint({}, {"project=local"}), HasSubstr("project=local is for maps in degrees"));
  Tiff mapWithoutCrs = mapOf(10);
  mapWithoutCrs.epsg = 0;
  write(map_, mapWithoutCrs);
  EXPECT_THAT(complaint({}), HasSubstr("a picture needs a height map that says where it lies"));
  RasterOptions o;
  o.drape = file("nowhere.tif");
  EXPECT_THAT(loadRaster(map_, o, 1).error().message, HasSubstr("there is no file"));
}

TEST_F(Drapes, AreCountedSharedAndToldApart) {
  const std::uint64_t before = bytesOfMaps();
  const auto one = load({}), plain = loadRaster(map_, {}, 1).value();
  EXPECT_GE(bytesOfMaps() - before, 2u * 4 * 30 * 20 + 4 * 120 * 90 * 4 / 3);
  EXPECT_LE(bytesOfMaps() - before, 2u * 4 * 30 * 20 + 4 * 120 * 90 * 4 / 3 + 4 * 300);
  RasterOptions o;
  o.drape = picture_;
  const std::uint64_t used = bytesOfMaps();
  const auto again = loadRaster(map_, o, 2).value();
  EXPECT_EQ(bytesOfMaps(), used);
  EXPECT_NE(terrain::contentHash(*one), terrain::contentHash(*plain));
  const auto other = load({.sample = [](int, int, int) { return 9; }});  // the same file's name
  EXPECT_NE(terrain::contentHash(*other), terrain::contentHash(*one));
  EXPECT_THAT(describe(*one->raster()), HasSubstr("draped with ortho.tif, 120 x 90 pixels, 0.5 m wide"));
  const auto filed = load({}, {}, {.inMemory = 0});
  EXPECT_EQ(terrain::contentHash(*filed), terrain::contentHash(*one));
}

}  // namespace
}  // namespace ridgecast::raster
