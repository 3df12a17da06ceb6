// GeoTIFFs of the ground, from the real server and without one, as GDAL reads them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;
using testing::StartsWith;

// What GDAL reads of a GeoTIFF.
struct Grid {
  nlohmann::json info;
  std::vector<float> heights;
};
Grid readGrid(const std::string& file) {
  const Finished told = runProgram({"gdalinfo", "-json", file}),
                 made = runProgram({"gdal_translate", "-q", "-of", "ENVI", file, file + ".f32"});
  EXPECT_EQ(told.code, 0) << told.output;
  EXPECT_EQ(made.code, 0) << made.output;
  Grid out{nlohmann::json::parse(told.output, nullptr, false), {}};
  const std::string bytes = readText(file + ".f32");
  out.heights.resize(bytes.size() / sizeof(float));
  std::memcpy(out.heights.data(), bytes.data(), bytes.size());
  return out;
}

TEST(GeoTiff, HeightsOnAGridAreAGeoTiffOfTheGroundAsItIs) {
  ServerProcess server(RIDGECAST_SERVER);
  ScratchFolder folder;
  const std::string file = folder / "ground.tif", at = "/v1/sessions/grid/snapshot.tif?x0=100.5&z0=-700&x1=500.6&z1=-460&spacing=0.8";
  ask(server.port(), "GET /v1/heights?at=0,0&session=grid&terrain=alpine");
  for (const std::uint64_t edits : {0, 1}) {
    const std::string answer = ask(server.port(), "GET " + at);
    ASSERT_THAT(answer, StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(answer, HasSubstr("\r\nContent-Type: image/tiff"));
    std::ofstream(file, std::ios::binary) << answer.substr(answer.find("\r\n\r\n") + 4);
    const Grid grid = readGrid(file);
    EXPECT_EQ(grid.info["size"], (nlohmann::json{501, 301}));
    EXPECT_EQ(grid.info["geoTransform"], (nlohmann::json{100.1, 0.8, 0.0, 700.4, 0.0, -0.8}));
    EXPECT_EQ(grid.info["metadata"]["IMAGE_STRUCTURE"]["LAYOUT"], "COG");
    EXPECT_EQ(grid.info["bands"][0]["unit"], "m");
    const auto description = nlohmann::json::parse(grid.info["metadata"][""]["TIFFTAG_IMAGEDESCRIPTION"].get<std::string>());
    EXPECT_EQ(description["terrain"], "alpine");
    EXPECT_EQ(description.value("edit", 0u), edits);
    EXPECT_EQ(description["box"], (nlohmann::json{{"x0", 100.5}, {"z0", -700.0}, {"x1", 500.5}, {"z1", -460.0}}));
    std::string places;
    for (int j = 0; j < 301; ++j)
      for (int i = 0; i < 501; ++i)
        for (const double v : {100.5 + 0.8 * i, -700 + 0.8 * j}) places.append(reinterpret_cast<const char*>(&v), sizeof v);
    std::vector<float> wanted;
    for (std::size_t from = 0; from < places.size(); from += 100'000 * 16) {
      const std::string part = places.substr(from, 100'000 * 16);
      SocketClient client(server.port());
      client.send(
          "POST /v1/heights?session=grid HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/octet-stream\r\n"
          "Content-Length: " +
          std::to_string(part.size()) + "\r\n\r\n" + part);
      const std::string all = client.answer(true), bytes = all.substr(all.find("\r\n\r\n") + 4);
      ASSERT_EQ(bytes.size(), part.size() / 4);
      wanted.resize(wanted.size() + bytes.size() / 4);
      std::memcpy(wanted.data() + from / 16, bytes.data(), bytes.size());
    }
    EXPECT_EQ(grid.heights, wanted);
    if (edits > 0) break;
    const std::string crater = R"({"op": "crater", "x": 300, "z": -600, "radius": 40, "depth": 9})";
    ASSERT_THAT(ask(server.port(), "POST /v1/sessions/grid/edits", crater), StartsWith("HTTP/1.1 201"));
  }
  for (const auto& [query, sentence] : std::vector<std::pair<std::string, std::string>>{
           {"x0=0&z0=0&x1=50&z1=50", "lacks 'spacing'"},
           {"x0=0&z0=0&x1=30000&z1=30000&spacing=1", "30001 x 30001 samples; it may have 16777216"},
           {"x0=0&z0=0&x1=50&z1=50&spacing=60", "fewer than 2 x 2"},
           {"x0=0&z0=0&x1=50&z1=50&spacing=1&error=1", "'error', which does not belong here. A GeoTIFF is of"},
           {"x=0&z=0&altitude=9&yaw=0&pitch=0&spacing=1", "lacks 'x0'"}}) {
    const std::string answer = ask(server.port(), "GET /v1/sessions/default/snapshot.tif?" + query);
    EXPECT_THAT(answer, testing::AllOf(StartsWith("HTTP/1.1 400"), HasSubstr(sentence))) << query;
  }
  EXPECT_TRUE(server.healthy());
}

// In its own CRS, a pitch that no step divides, rows and columns apart: what comes out is what went in.
TEST(GeoTiff, AHeightMapComesBackAsItWas) {
  ScratchFolder folder;
  const std::string raw = folder / "map.asc", map = folder / "map.tif", out = folder / "out.tif", part = folder / "part.tif";
  {
    std::ofstream text(raw);
    text.precision(12);
    text << "ncols 37\nnrows 23\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
    std::mt19937 random(5);
    for (int k = 0; k < 37 * 23; ++k) text << 500 + random() % 30'000 / 256.0 << (k % 37 == 36 ? "\n" : " ");
  }
  Finished done = runProgram({"gdal_translate", "-q", "-ot", "Float32", "-a_srs", "EPSG:2056", "-a_ullr", "2600000.5", "1200008",
                              "2600012.833333333", "1200000.1333333333", raw, map});
  ASSERT_EQ(done.code, 0) << done.output;
  const std::vector<std::string> shoot{RIDGECAST_CLIENT, "snapshot", "--terrain", map, "--box"};
  const auto with = [&](std::vector<std::string> more) {
    std::vector<std::string> command = shoot;
    command.insert(command.end(), more.begin(), more.end());
    return runProgram(command);
  };
  done = with({"all", "--out", out});
  ASSERT_EQ(done.code, 0) << done.output;
  const Grid was = readGrid(map), is = readGrid(out);
  EXPECT_EQ(is.heights, was.heights);
  EXPECT_EQ(is.info["size"], was.info["size"]);
  EXPECT_EQ(is.info["stac"]["proj:epsg"], 2056);
  for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(is.info["geoTransform"][k], was.info["geoTransform"][k].get<double>(), 1e-6) << k;
  const auto place = nlohmann::json::parse(is.info["metadata"][""]["TIFFTAG_IMAGEDESCRIPTION"].get<std::string>())["georeference"];
  const auto corner = was.info["wgs84Extent"]["coordinates"][0][0];
  EXPECT_EQ(place["crs"], "EPSG:2056");
  EXPECT_NEAR(place["longitude"], corner[0].get<double>(), 1e-5);
  EXPECT_NEAR(place["latitude"], corner[1].get<double>(), 1e-5);
  // Those samples that lie in a box of the map's own CRS.
  done = with({"2600003.9,1200002,2600008.9,1200006", "--crs", "EPSG:2056", "--out", part});
  ASSERT_EQ(done.code, 0) << done.output;
  const Grid some = readGrid(part);
  const double pitchX = 12.333333333 / 37, pitchY = 7.8666666667 / 23;
  const auto column = static_cast<std::size_t>(std::lround((some.info["geoTransform"][0].get<double>() - 2600000.5) / pitchX));
  const auto row = static_cast<std::size_t>(std::lround((1200008 - some.info["geoTransform"][3].get<double>()) / pitchY));
  const std::size_t columns = some.info["size"][0], rows = some.info["size"][1];
  EXPECT_EQ(column, 10u);
  EXPECT_EQ(columns, 15u);
  for (std::size_t j = 0; j < rows; ++j)
    for (std::size_t i = 0; i < columns; ++i)
      EXPECT_EQ(some.heights[j * columns + i], was.heights[(row + j) * 37 + column + i]) << i << " " << j;
  done = with({"all", "--spacing", "0.25", "--out", part});
  ASSERT_EQ(done.code, 0) << done.output;
  EXPECT_EQ(readGrid(part).info["size"], (nlohmann::json{49, 31}));
}

}  // namespace
}  // namespace ridgecast
