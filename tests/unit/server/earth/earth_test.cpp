#include "server/earth/earth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace ridgecast::earth {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// The reference: EPSG Guidance Note 7-2, 53°48'33.82"N 2°07'46.38"E, 73 m is (3771793.968, 140253.342, 5124304.349).
TEST(Earth, TheTangentPlaneLiesOnTheEllipsoid) {
  const Place place{2.1295500 * kDegree, 53.8093944 * kDegree, 73};
  const auto m = eastNorthUp(place);
  EXPECT_NEAR(m[12], 3771793.968, 0.01);
  EXPECT_NEAR(m[13], 140253.342, 0.01);
  EXPECT_NEAR(m[14], 5124304.349, 0.01);
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b) {
      double dot = 0;
      for (std::size_t k = 0; k < 3; ++k) dot += m[4 * a + k] * m[4 * b + k];
      EXPECT_NEAR(dot, a == b, 1e-15);
    }
  // Ten metres up, north and east of it are where the formula says.
  const auto higher = eastNorthUp({place.longitude, place.latitude, 83});
  const auto norther = eastNorthUp({place.longitude, place.latitude + 1e-6, 73}),
             easter = eastNorthUp({place.longitude + 1e-6, place.latitude, 73});
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(higher[12 + k] - m[12 + k], 10 * m[8 + k], 1e-8);
  const auto along = [&](const std::array<double, 16>& other, std::size_t axis) {
    double dot = 0;
    for (std::size_t k = 0; k < 3; ++k) dot += (other[12 + k] - m[12 + k]) * m[4 * axis + k];
    return dot;
  };
  EXPECT_GT(along(norther, 1), 6);
  EXPECT_NEAR(along(norther, 0), 0, 1e-3);
  EXPECT_GT(along(easter, 0), 3);
  EXPECT_NEAR(along(easter, 1), 0, 1e-3);
}

// The reference: proj4js 2.
TEST(Earth, AMapInUtmLiesWhereItsCoordinatesSay) {
  struct Case {
    const char* crs;
    double easting, northing;
    double here[3], there[3];  // EPSG:4978 of the place, and of one 5 km east and 3 km north on the grid
  };
  for (const Case& c :
       {Case{"EPSG:32632", 680'000, 5'240'000, {4248938.9355, 855234.1397, 4663597.9439}, {4245882.9510, 859810.3319, 4665526.3590}},
        Case{"EPSG:32633", 250'000, 8'800'000, {1214672.2951, 66679.6294, 6240058.6434}, {1210568.1072, 70750.6208, 6240806.2900}},
        Case{"EPSG:32756", 334'786, 6'252'080, {-4646810.7768, 2553125.0359, -3533438.8136}, {-4650663.8119, 2549478.0346, -3531018.3790}},
        Case{"EPSG:32701",
             800'000,
             1'200'000,
             {-1172814.8845, -361776.3355, -6237948.9717},
             {-1175450.9784, -366912.1642, -6237158.1027}}}) {
    const auto m = onEarth(c.crs, {c.easting, c.northing}, {c.easting, c.northing});
    ASSERT_TRUE(m) << c.crs;
    double up = 0, off = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR((*m)[12 + k], c.here[k], 0.001) << c.crs;
      const double d = (*m)[12 + k] + 5000 * (*m)[k] + 3000 * (*m)[4 + k] - c.there[k];
      up += d * (*m)[8 + k];
      off += d * d;
    }
    EXPECT_NEAR(up, 5831.0 * 5831 / 2 / 6.38e6, 0.1) << c.crs << ": the Earth falls away below the plane";
    EXPECT_LT(std::sqrt(std::max(0.0, off - up * up)), 0.3) << c.crs;
  }
  const auto europe = onEarth("EPSG:25832", {680'000, 5'240'000}, {680'000, 5'240'000}),
             world = onEarth("EPSG:32632", {680'000, 5'240'000}, {680'000, 5'240'000});
  for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR((*europe)[k], (*world)[k], 1e-3);
}

TEST(Earth, AMapInDegreesLiesOnItsOwnPlane) {
  const auto middle = onEarth("+proj=ortho +lat_0=47.5 +lon_0=11.25 +datum=WGS84 +units=m", {0, 0}, {0, 0});
  ASSERT_TRUE(middle);
  const auto beside = onEarth("+proj=ortho +lat_0=47.5 +lon_0=11.25 +datum=WGS84 +units=m", {300, -40}, {300, -40});
  ASSERT_TRUE(beside);
  const Matrix wanted = eastNorthUp({11.25 * kDegree, 47.5 * kDegree});
  for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR((*middle)[k], wanted[k], 1e-6);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR((*beside)[12 + k], (*middle)[12 + k] + 300 * (*middle)[k] - 40 * (*middle)[4 + k], 0.01) << "the Earth is curved";
}

// The references: cs2cs of PROJ 9.1 to EPSG:4978.
TEST(Earth, NationalGridsLieWhereTheyAre) {
  struct Case {
    const char* crs;
    double metres, easting, northing;
    double here[3];
  };
  for (const Case& c : {Case{"EPSG:2056", 1, 2'600'000, 1'200'000, {4324955.9890, 564679.3168, 4638054.2848}},
                        Case{"EPSG:2263", 12 / 39.37, 1'000'000, 200'000, {1339043.5823, -4652383.4934, 4138537.3063}},
                        Case{"EPSG:27700", 1, 400'000, 300'000, {3879962.3422, -135588.4369, 5043481.8303}},
                        Case{"EPSG:31287", 1, 400'000, 400'000, {4200560.8231, 995493.9656, 4679458.8478}},
                        Case{"EPSG:3035", 1, 4'321'000, 3'210'000, {3875179.5754, 683298.7142, 5002803.3455}},
                        Case{"+proj=somerc +lat_0=46.9524055555556 +lon_0=7.43958333333333 +k_0=1 +x_0=2600000 +y_0=1200000 +ellps=bessel "
                             "+towgs84=674.374,15.056,405.346,0,0,0,0 +units=m +no_defs",
                             1,
                             2'600'000,
                             1'200'000,
                             {4324955.9890, 564679.3168, 4638054.2848}},
                        Case{"EPSG:28992", 1, 155'000, 463'000, {3904019.6961, 368158.8149, 5013414.8210}}}) {
    const auto m = onEarth(c.crs, {c.easting * c.metres, c.northing * c.metres}, {c.easting * c.metres, c.northing * c.metres});
    ASSERT_TRUE(m) << c.crs;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR((*m)[12 + k], c.here[k], 0.01) << c.crs;
    const double scale = std::hypot((*m)[0], (*m)[1], (*m)[2]);
    EXPECT_NEAR(scale, 1, 0.002) << c.crs;
  }
}

// A map 300 km east of its zone's meridian, laid elsewhere: its grid stays turned against north, here by 2.7 degrees.
TEST(Earth, AMapLaidElsewhereStaysTurnedAsItsGridIs) {
  class Map final : public terrain::Raster {
   public:
    const terrain::RasterShape& shape() const override { return shape_; }
    terrain::RasterOrigin origin() const override {
      terrain::RasterOrigin out;
      out.crs = "EPSG:32632";
      out.easting = 800'000;
      out.northing = 5'240'000;
      return out;
    }
    void tile(terrain::TileAddress, terrain::Tile& out) const override { out.fill(0); }
    terrain::RasterShape shape_{.width = 3, .height = 3};
  };
  const Map map;
  const lattice::Point middle{map.shape().x.of(1), map.shape().z.of(1)};
  const auto there = Placement::of(&map, middle, {{}, Heights::kEllipsoid}),
             elsewhere = Placement::of(&map, middle, {placeOf("-70,-33,100"), Heights::kEllipsoid});
  ASSERT_TRUE(there && elsewhere);
  const auto own = there->at(middle), moved = elsewhere->at(middle);
  ASSERT_TRUE(own && moved);
  EXPECT_EQ(*own, *onEarth("EPSG:32632", {800'000, 5'240'000}, {800'000, 5'240'000}));
  const Matrix straight = eastNorthUp(*placeOf("-70,-33,100"));
  for (std::size_t k = 8; k < 16; ++k) EXPECT_NEAR((*moved)[k], straight[k], 1e-6);
  double east = 0, north = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    east += (*moved)[k] * straight[k];
    north += (*moved)[k] * straight[4 + k];
  }
  const double longitude = std::atan2((*own)[9], (*own)[8]), latitude = std::asin((*own)[10]);
  EXPECT_NEAR(std::atan2(-north, east), std::atan(std::tan(longitude - 9 * kDegree) * std::sin(latitude)), 1e-4) << "the convergence";
  EXPECT_FALSE(Placement::of(nullptr, {}, Where()));
}

// The references: EGM96 as its authors publish it, 17.16 m at the equator and Greenwich, 13.61 m at the north pole.
TEST(Earth, TheSeaLiesWhereEgm96HasIt) {
  ASSERT_TRUE(seaLevel({})) << "PROJ's grid egm96_15.gtx is missing: install proj-data";
  EXPECT_NEAR(*seaLevel({0, 0}), 17.16, 0.1);
  EXPECT_NEAR(*seaLevel({0, 90 * kDegree}), 13.61, 0.1);
  const Place innsbruck{11.39 * kDegree, 47.27 * kDegree};
  const auto sea = Placement::of(nullptr, {}, {innsbruck, Heights::kSea}),
             ellipsoid = Placement::of(nullptr, {}, {innsbruck, Heights::kEllipsoid});
  ASSERT_TRUE(sea && ellipsoid);
  EXPECT_EQ(sea->heights(), Heights::kSea);
  const Matrix high = *sea->at({}), low = *ellipsoid->at({});
  for (std::size_t k = 0; k < 3; ++k) EXPECT_NEAR(high[12 + k] - low[12 + k], *seaLevel(innsbruck) * low[8 + k], 1e-6);
  EXPECT_GT(*seaLevel(innsbruck), 45);
  EXPECT_LT(*seaLevel(innsbruck), 55);
}

TEST(Earth, AMatrixTimesItsInverseIsOne) {
  const Matrix m = *onEarth("EPSG:2056", {2'700'000, 1'100'000}, {2'700'000, 1'100'000});
  const Matrix one = product(inverse(m), m);
  for (std::size_t k = 0; k < 16; ++k) EXPECT_NEAR(one[k], k % 5 == 0, 1e-8) << k;
}

TEST(Earth, OtherMapsArePlacedByHand) {
  for (const char* crs : {"", "EPSG:4326", "EPSG:99999", "EPSG:32600", "EPSG:", "EPSG:x", "+proj=ortho +lat_0=a +lon_0=b"})
    EXPECT_FALSE(onEarth(crs, {0, 0}, {0, 0})) << crs;
}

}  // namespace
}  // namespace ridgecast::earth
