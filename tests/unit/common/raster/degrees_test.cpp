// Height maps in degrees, ASCII grids, SRTM's files, and holes that are filled.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>

#include "common/process/scratch.h"
#include "common/raster/degrees.h"
#include "common/raster/raster_terrain.h"

namespace ridgecast::raster {
namespace {

using testing::HasSubstr;

class DegreesTest : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    auto path = scratch_->path() / name;
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }
  static Outcome<std::shared_ptr<const terrain::Terrain>> load(const std::filesystem::path& path,
                                                               const std::vector<std::string>& options = {}) {
    RasterOptions o;
    for (const std::string& option : options) EXPECT_TRUE(addRasterOption(option, o)) << option;
    return loadRaster(path, o, 1);
  }
  static std::string complaint(const std::filesystem::path& path, const std::vector<std::string>& options = {}) {
    const auto loaded = load(path, options);
    return loaded ? "it was loaded" : loaded.error().message;
  }
  // height(longitude, latitude), samples 0.008 degrees apart.
  template <class F>
  static std::string grid(int columns, int rows, double west, double south, F&& height) {
    std::ostringstream out;
    out.precision(12);
    out << "ncols " << columns << "\nNROWS " << rows << "\nxllcenter " << west << "\nyllcenter " << south << "\ncellsize 0.008\n";
    for (int j = rows - 1; j >= 0; --j)
      for (int i = 0; i < columns; ++i) out << height(west + i * 0.008, south + j * 0.008) << (i + 1 < columns ? ' ' : '\n');
    return out.str();
  }

  std::optional<process::Scratch> scratch_ = process::Scratch::create().value();
};

using Point3 = std::array<double, 3>;

Point3 onEarth(double longitude, double latitude) {  // textbook
  const double l = longitude * std::numbers::pi / 180, p = latitude * std::numbers::pi / 180, b = 6'378'137 * (1 - 1 / 298.257223563);
  const double n = 6'378'137.0 * 6'378'137.0 / std::hypot(6'378'137 * std::cos(p), b * std::sin(p));
  return {n * std::cos(p) * std::cos(l), n * std::cos(p) * std::sin(l), b * b / (6'378'137.0 * 6'378'137.0) * n * std::sin(p)};
}

// East and north of the middle: by vectors, which share nothing with the closed formulas.
std::array<double, 2> seenFrom(double longitude0, double latitude0, double longitude, double latitude) {
  const Point3 a = onEarth(longitude0, latitude0), b = onEarth(longitude, latitude);
  const double l = longitude0 * std::numbers::pi / 180, p = latitude0 * std::numbers::pi / 180;
  const Point3 d{b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  return {-std::sin(l) * d[0] + std::cos(l) * d[1],
          -std::sin(p) * std::cos(l) * d[0] - std::sin(p) * std::sin(l) * d[1] + std::cos(p) * d[2]};
}

TEST_F(DegreesTest, PlacesOfTheMapHaveItsHeightsOnThePlane) {
  for (const auto& [west, south] : {std::pair{11.0, 47.0}, {-71.3, -33.2}, {179.0, 0.0}, {20.0, 69.5}}) {
    const auto height = [west = west, south = south](double l, double p) { return 1000 + 900 * (l - west) - 700 * (p - south); };
    const auto loaded = load(write("map.asc", grid(61, 41, west, south, height)), {"project=local"});
    ASSERT_TRUE(loaded) << loaded.error().message;
    const terrain::RasterShape& shape = (*loaded)->raster()->shape();
    EXPECT_EQ(shape.x.of(shape.width / 2), 0);
    EXPECT_EQ(shape.width % 2 + shape.height % 2, 2u) << "the middle is a sample";
    int inside = 0;
    for (int i = 2; i < 59; i += 3)
      for (int j = 2; j < 39; j += 3) {
        const double l = west + i * 0.008, p = south + j * 0.008;
        const auto [east, north] = seenFrom(west + 0.24, south + 0.16, l, p);
        const auto x = static_cast<lattice::Step>(std::llround(east * 256)), z = static_cast<lattice::Step>(std::llround(-north * 256));
        const lattice::Step edge = 2 * static_cast<lattice::Step>(shape.x.steps());  // nearer to it, the cubic sees how the map goes on
        if (std::abs(x) > -shape.x.origin - edge || std::abs(z) > -shape.z.origin - edge) continue;
        ++inside;
        EXPECT_NEAR((*loaded)->height({x, z}), height(l, p), 0.01) << l << " " << p;
      }
    EXPECT_GT(inside, 180) << "of 247: the rectangle is most of the map";
    EXPECT_THAT((*loaded)->raster()->origin().crs, HasSubstr("+proj=ortho +lat_0="));
    EXPECT_EQ((*loaded)->raster()->origin().easting, 0.0);
  }
}

// How far the ground is off rough samples at most, and what the start line says of it.
TEST_F(DegreesTest, ThePlaneSaysHowFarItIsOffTheSamples) {
  std::mt19937 random(5);
  std::vector<double> heights;
  const auto file = write("rough.asc", grid(61, 41, 11, 47, [&](double, double) {
                            heights.push_back(100 + static_cast<double>(random() % 4000) / 10);  // rows from the north
                            return heights.back();
                          }));
  const auto errors = [&](const std::vector<std::string>& options) {
    const auto loaded = load(file, options).value();
    const terrain::RasterShape& shape = loaded->raster()->shape();
    double most = 0;
    int inside = 0;
    for (int j = 0; j < 41; ++j)
      for (int i = 0; i < 61; ++i) {
        const auto [east, north] = seenFrom(11.24, 47.16, 11 + i * 0.008, 47.32 - j * 0.008);
        const lattice::Point at{std::llround(east * 256), std::llround(-north * 256)};
        if (!shape.area().holds(at)) continue;
        ++inside;
        most = std::max(most, std::abs(static_cast<double>(loaded->height(at)) -
                                       heights[static_cast<std::size_t>(j) * 61 + static_cast<std::size_t>(i)]));
      }
    EXPECT_GT(inside, 1800) << "of 2,501";
    EXPECT_THAT(loaded->raster()->origin().read, HasSubstr("; " + std::to_string(2501 - inside) + " of them lie beyond"));
    double said = -1;
    EXPECT_EQ(std::sscanf(loaded->raster()->origin().read.c_str(), "laid on a plane, within %lf m of its samples", &said), 1);
    EXPECT_NEAR(most, said, 0.4);  // a place is half a step off, on slopes of 400 m in 150 m
    return said;
  };
  const double asClose = errors({"project=local", "pitch=604"}), byDefault = errors({"project=local"});
  EXPECT_GT(asClose, 40);
  EXPECT_LT(byDefault, asClose / 8);
}

TEST_F(DegreesTest, AreRefusedWithTheZoneToUse) {
  const auto flat = [](double, double) { return 5; };
  for (const auto& [west, south, epsg] : {std::tuple(11.0, 47.0, 32632),
                                          {-71.3, -33.2, 32719},
                                          {-179.9, 0.1, 32601},
                                          {179.0, 10.0, 32660},
                                          {5.0, 84.5, 32661},
                                          {5.0, -85.0, 32761}}) {
    const auto file = write("map.asc", grid(9, 9, west, south, flat));
    EXPECT_THAT(complaint(file),
                testing::AllOf(HasSubstr("degrees apart"), HasSubstr("EPSG:" + std::to_string(epsg) + ")"), HasSubstr("project=local")));
    EXPECT_TRUE(load(file, {"pitch=30"}));
  }
  std::string far = "ncols 3000\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 0.01\n";
  for (int k = 0; k < 6000; ++k) far += "1 ";
  EXPECT_THAT(complaint(write("wide.asc", far), {"project=local"}), HasSubstr("more than 10 degrees"));
  EXPECT_THAT(complaint(write("map.asc", grid(9, 9, 11, 47, flat)), {"project=local", "place=geo"}),
              HasSubstr("leave --raster place=geo out"));
  EXPECT_THAT(complaint(write("map.asc", "ncols 2\nnrows 2\ncellsize 10\n1 2 3 4"), {"project=local"}), HasSubstr("leave it out"));
}

TEST_F(DegreesTest, AsciiGridsInMetresHaveAPlace) {
  const auto loaded =
      load(write("map.asc", "ncols 3\nnrows 2\nxllcorner 500\nyllcorner 7000\ncellsize 10\nnodata_value -1\n1.5 2 3\r\n4 5 6e0\n"),
           {"place=geo"});
  ASSERT_TRUE(loaded) << loaded.error().message;
  const terrain::RasterShape& shape = (*loaded)->raster()->shape();
  EXPECT_EQ(shape.x.origin, 505 * 256);
  EXPECT_EQ(shape.z.origin, -7015 * 256);
  EXPECT_EQ((*loaded)->height({505 * 256, -7015 * 256}), 1.5);
  EXPECT_EQ((*loaded)->height({525 * 256, -7005 * 256}), 6);
}

TEST_F(DegreesTest, BrokenAsciiGridsGiveAMessage) {
  const std::string head = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n";
  for (const auto& [text, said] : std::vector<std::pair<std::string, std::string>>{
           {"", "this is not an ASCII grid"},
           {"1 2 3", "this is not an ASCII grid"},
           {"ncols x\n", "'ncols x' does not belong"},
           {"ncols 3\nncols 3\n", "'ncols 3' does not belong"},
           {"depth 3\n", "'depth 3' does not belong"},
           {"ncols 3.5\nnrows 2\ncellsize 1\n1", "this is not an ASCII grid"},
           {"ncols 3\nnrows 2\ncellsize -1\n1", "this is not an ASCII grid"},
           {"ncols 1000000\nnrows 1000000\ncellsize 1\n1", "it claims 1000000 x 1000000 samples"},
           {head + "1 2 3 4 5", "it ends in row 1; it is cut off"},
           {head + "1 2 3 4 x 6", "'x' at column 1, row 1 is not a number"},
           {head + "1 2 3 4 nan 6", "1 samples are missing (NoData), the first at column 1, row 1"},
           {head + "1 2 3 4 inf 6", "is not a number"},
           {"nodata_value nan\n" + head + "nan 2 3 4 5 6", "1 samples are missing (NoData), the first at column 0, row 0"},
           {head + "1 2 3 4 5 6 7", "more samples than ncols x nrows"},
           {head + "1 2 3 4 5 " + std::string(500, '6'), "is not a number"}})
    EXPECT_THAT(complaint(write("map.asc", text)), testing::AllOf(HasSubstr("map.asc: "), HasSubstr(said))) << text;
}

TEST_F(DegreesTest, SrtmFilesAreReadByTheirNames) {
  std::string bytes;
  for (int k = 0; k < 11 * 11; ++k) bytes.append({static_cast<char>(k), '\x7f'});  // most significant byte first
  const auto file = write("S34W071.hgt", bytes);
  EXPECT_THAT(complaint(file), HasSubstr("EPSG:32719"));
  const auto loaded = load(file, {"pitch=100"});
  ASSERT_TRUE(loaded);
  EXPECT_EQ((*loaded)->height({(*loaded)->raster()->shape().x.origin, (*loaded)->raster()->shape().z.origin}), 0x7f);
  const auto local = load(file, {"project=local", "pitch=1000"});
  ASSERT_TRUE(local) << local.error().message;
  EXPECT_THAT((*local)->raster()->origin().crs, HasSubstr("+lat_0=-33.5 +lon_0=-70.5"));
  EXPECT_THAT(complaint(write("map.hgt", bytes)), HasSubstr("named after its south-west corner"));
  EXPECT_THAT(complaint(write("X34W071.hgt", bytes)), HasSubstr("named after its south-west corner"));
  EXPECT_THAT(complaint(write("N47E011.hgt", bytes.substr(1))), HasSubstr("no square of 16-bit samples"));
  EXPECT_THAT(complaint(write("N47E011.hgt", "")), HasSubstr("at least 2 x 2"));
  bytes[0] = '\x80', bytes[1] = 0;
  EXPECT_THAT(complaint(write("N47E011.hgt", bytes), {"pitch=30"}), HasSubstr("1 samples are missing"));
}

std::vector<std::int32_t> filled(std::uint32_t width, std::uint32_t height, const std::function<std::int32_t(int, int)>& sample,
                                 bool* fine = nullptr) {
  auto samples = Samples::create(width, height, 1 << 20);
  for (std::uint32_t z = 0; z < height; ++z)
    for (std::uint32_t x = 0; x < width; ++x) samples->row(z)[x] = sample(static_cast<int>(x), static_cast<int>(z));
  const bool all = fillMissing(*samples);
  if (fine) *fine = all;
  std::vector<std::int32_t> out;
  for (std::uint32_t z = 0; z < height; ++z) out.insert(out.end(), samples->row(z).begin(), samples->row(z).end());
  return out;
}

// Where a hole has known ground on all four sides, a plane goes on through it: distances weigh as they must.
TEST(Filling, KeepsAPlane) {
  const auto plane = [](int x, int z) { return 1000 + 70 * x - 30 * z; };
  const auto all = filled(40, 30, [&](int x, int z) {
    const bool hole = std::hypot(x - 18, z - 14) < 9 || (x == 3 && z == 3) || (x > 30 && x < 35 && z > 2 && z < 27);
    return hole ? kMissing : plane(x, z);
  });
  for (int z = 0; z < 30; ++z)
    for (int x = 0; x < 40; ++x)
      EXPECT_EQ(all[40 * static_cast<std::size_t>(z) + static_cast<std::size_t>(x)], plane(x, z)) << x << " " << z;
}

TEST(Filling, ReachesCornersAndStaysWithinItsNeighbours) {
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round) {
    const int known = static_cast<int>(random() % 20);
    std::vector<std::int32_t> samples(12 * 9, kMissing);
    for (int k = 0; k < known; ++k) samples[random() % samples.size()] = static_cast<std::int32_t>(random() % 1000);
    bool fine = false;
    const auto all = filled(
        12, 9, [&](int x, int z) { return samples[12 * static_cast<std::size_t>(z) + static_cast<std::size_t>(x)]; }, &fine);
    EXPECT_EQ(fine, known > 0);
    if (!fine) continue;
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (samples[k] != kMissing) {
        EXPECT_EQ(all[k], samples[k]);
      }
      EXPECT_TRUE(all[k] >= 0 && all[k] < 1000) << all[k];
    }
  }
}

TEST_F(DegreesTest, HolesAreFilledWhenSaidSo) {
  const std::string head = "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\nnodata_value -9\n";
  const auto file = write("map.asc", head + "1 2 3 4 -9 6 7 8 9");
  EXPECT_THAT(complaint(file), HasSubstr("nodata=fill"));
  const auto loaded = load(file, {"nodata=fill"});
  ASSERT_TRUE(loaded);
  EXPECT_EQ((*loaded)->height({(*loaded)->raster()->shape().x.origin + 2560, (*loaded)->raster()->shape().z.origin + 2560}), 5);
  EXPECT_THAT(complaint(write("map.asc", head + "-9 -9 -9 -9 -9 -9 -9 -9 -9"), {"nodata=fill"}), HasSubstr("nothing to fill them from"));
}

}  // namespace
}  // namespace ridgecast::raster
