// The C interface's terrains, which need no server.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "common/terrain/terrain.h"
#include "tests/integration/c_handles.h"

namespace ridgecast {
namespace {

TEST(CTerrain, HasTheBitsOfTheTerrainFarOutToo) {
  rc_terrain_options options{};
  options.size = sizeof options;
  options.seed = 7;
  const Terrain canyon = open("canyon", &options);
  const auto expected = terrain::create("canyon", 7).value();
  EXPECT_EQ(rc_terrain_hash(canyon.get()), terrain::contentHash(*expected));
  const std::vector<double> places = randomPlaces(20'000);
  std::vector<lattice::Step> x, z;
  for (std::size_t k = 0; k < places.size(); k += 2) {
    x.push_back(std::llround(std::floor(places[k] * 256 + 0.5)));
    z.push_back(std::llround(std::floor(places[k + 1] * 256 + 0.5)));
  }
  std::vector<float> same(x.size());
  expected->heights(x, z, same);
  EXPECT_EQ(heightsOf(canyon.get(), places), same);
}

TEST(CTerrain, SaysWhichPlaceIsWrong) {
  const Terrain alpine = open("alpine");
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 5e12, -1e300}) {
    std::vector<double> places(2 * 9000, 1.0);
    places[2 * 8000 + 1] = bad;
    std::vector<float> out(9000);
    EXPECT_EQ(rc_terrain_heights(alpine.get(), places.data(), 9000, out.data()), RC_INVALID);
    EXPECT_NE(std::string(rc_message()).find("place 8000 "), std::string::npos) << rc_message();
  }
  EXPECT_EQ(rc_terrain_heights(alpine.get(), nullptr, 1, nullptr), RC_INVALID);
  EXPECT_EQ(rc_terrain_heights(alpine.get(), nullptr, 0, nullptr), RC_OK);
  EXPECT_EQ(rc_terrain_heights(nullptr, nullptr, 0, nullptr), RC_INVALID);
}

TEST(CTerrain, RefusesWhatItCannotOpen) {
  rc_terrain* out = nullptr;
  EXPECT_EQ(rc_terrain_open("alpin", nullptr, &out), RC_REFUSED);
  EXPECT_NE(std::string(rc_message()).find("alpine"), std::string::npos) << rc_message();
  EXPECT_EQ(rc_terrain_open("/nowhere.tif", nullptr, &out), RC_REFUSED);
  EXPECT_EQ(rc_terrain_open(nullptr, nullptr, &out), RC_INVALID);
  rc_terrain_options options{};
  EXPECT_EQ(rc_terrain_open("alpine", &options, &out), RC_INVALID) << "without a size";
  options.size = sizeof options;
  options.raster = "pitch=";
  EXPECT_EQ(rc_terrain_open("alpine", &options, &out), RC_INVALID);
  EXPECT_EQ(out, nullptr);
  EXPECT_EQ(rc_terrain_hash(nullptr), 0u);
  rc_terrain_close(nullptr);
}

// An older program's struct ends before our last fields, a newer one's goes on behind them.
TEST(CTerrain, ReadsStructsOfOlderAndNewerPrograms) {
  struct {
    rc_terrain_options options;
    char more[64];
  } newer{};
  std::memset(newer.more, 0x5a, sizeof newer.more);
  newer.options.size = sizeof newer;
  newer.options.seed = 5;
  EXPECT_EQ(rc_terrain_hash(open("alpine", &newer.options).get()), terrain::contentHash(*terrain::create("alpine", 5).value()));
  rc_terrain_options older{};
  std::memset(&older, 0x5a, sizeof older);
  older.size = offsetof(rc_terrain_options, parameters);
  older.seed = 5;
  older.parameter_count = 0;
  EXPECT_EQ(rc_terrain_hash(open("alpine", &older).get()), terrain::contentHash(*terrain::create("alpine", 5).value()));
}

TEST(CTerrain, RaysHitTheGroundWithItsNormal) {
  const Terrain alpine = open("alpine");
  const std::vector<rc_ray> rays{{{100, 5000, 200}, {0, -2, 0}, 1e5}, {{100, 5000, 200}, {0, 1, 0}, 1e5}};
  std::array<rc_hit, 2> hits{};
  ASSERT_EQ(rc_terrain_rays(alpine.get(), rays.data(), 2, hits.data()), RC_OK) << rc_message();
  const double place[2] = {100, 200};
  float height = 0, normal[3];
  ASSERT_EQ(rc_terrain_heights(alpine.get(), place, 1, &height), RC_OK);
  ASSERT_EQ(rc_terrain_normals(alpine.get(), place, 1, 0, normal), RC_OK);
  EXPECT_NEAR(hits[0].at[1], height, 1e-3);
  EXPECT_NEAR(hits[0].distance, 5000 - height, 1e-3);
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(hits[0].normal[k], normal[k]);
  EXPECT_EQ(hits[1].distance, -1);
  rc_ray bad = rays[0];
  bad.direction[1] = 0;
  EXPECT_EQ(rc_terrain_rays(alpine.get(), &bad, 1, hits.data()), RC_INVALID);
  EXPECT_EQ(rc_terrain_normals(alpine.get(), place, 1, -1, normal), RC_INVALID);
}

}  // namespace
}  // namespace ridgecast
