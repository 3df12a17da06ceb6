// Flights over a height map and over a private terrain: real server, real client. Need EGL; skip, saying why, where there is none.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "client/core/ground/height_window.h"
#include "client/link/client.h"
#include "client/render/context.h"
#include "client/render/picture.h"
#include "common/raster/raster_terrain.h"
#include "tests/support/geo_tiff.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;

class TerrainFlight : public testing::Test {
 protected:
  void SetUp() override {
    if (auto context = render::HeadlessContext::create(); !context) GTEST_SKIP() << context.error().message;
    std::ofstream(folder_ / "path.json") << R"({"keyframes": [{"t": 0, "x": 500, "z": 900, "altitude": 150, "yaw": 10, "pitch": -15},
                                               {"t": 0.5, "x": 520, "z": 800, "altitude": 150, "yaw": 15, "pitch": -15}]})";
  }
  nlohmann::json fly(const ServerProcess& server, const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{RIDGECAST_CLIENT,
                                     "fly",
                                     server.url(),
                                     "--path",
                                     (folder_ / "path.json").string(),
                                     "--out",
                                     (folder_ / "out").string(),
                                     "--size",
                                     "320x180",
                                     "--rate",
                                     "4",
                                     "--threshold",
                                     "2"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished finished = runProgram(command);
    output_ = finished.output;
    EXPECT_EQ(finished.code, 0) << finished.output;
    std::ifstream in(folder_ / "out/summary.json");
    return nlohmann::json::parse(in, nullptr, false);
  }
  ScratchFolder folder_;
  std::string output_;
};

// 300 x 200 samples of 5 cm.
void writeHills(const std::string& file) {
  std::ofstream map(file, std::ios::binary);
  for (int z = 0; z < 200; ++z)
    for (int x = 0; x < 300; ++x) {
      const int v = static_cast<int>(9000 + 4000 * std::sin(x * 0.11) * std::cos(z * 0.09) + 1500 * std::sin(x * 0.31 + z * 0.4));
      map.put(static_cast<char>(v & 255)).put(static_cast<char>(v >> 8));
    }
}

std::vector<std::string> served(const std::string& map, const std::vector<std::string>& how) {
  std::vector<std::string> arguments{"--terrain", map};
  for (const std::string& option : how) arguments.insert(arguments.end(), {"--raster", option});
  return arguments;
}

TEST_F(TerrainFlight, OverAHeightMapTheMeshLooksLikeTheRayMarch) {
  writeHills(folder_ / "hills.r16");
  ServerProcess server(RIDGECAST_SERVER, served(folder_ / "hills.r16", {"size=300x200", "pitch=25", "scale=0.05", "edge=mirror"}));
  SocketClient client(server.port());
  client.send("GET /v1/sessions HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const std::string answer = client.answer();
  const auto sessions = nlohmann::json::parse(answer.substr(answer.find("\r\n\r\n")), nullptr, false);
  const auto& map = sessions["sessions"][0]["height_map"];
  EXPECT_EQ(map["columns"], 300) << answer;
  EXPECT_EQ(map["pitch"], 25);
  EXPECT_EQ(map["x"], -3750);
  EXPECT_EQ(map["edge"], "mirror");
  const auto summary = fly(server, {"--no-remote-shaders"});  // its text is the client's own
  EXPECT_EQ(summary["terrain"], "hills");
  EXPECT_EQ(summary["hash_mismatches"], 0);
  EXPECT_GT(summary["ssim_settled"], 0.93) << output_;
  EXPECT_GT(summary["ssim_settled_terrain"], 0.9);
}

TEST_F(TerrainFlight, DetailOnAMapIsTheSameGroundOnEverySide) {
  const std::string map = folder_ / "hills.r16";
  writeHills(map);
  const std::vector<std::string> how{"size=300x200", "pitch=25", "scale=0.05", "edge=mirror", "detail=alpine:0.4"};
  ServerProcess server(RIDGECAST_SERVER, served(map, how));
  std::mt19937_64 random(2);
  std::vector<lattice::Step> x, z;
  std::string places;
  for (int k = 0; k < 5000; ++k) {
    x.push_back(500 * 256 + static_cast<lattice::Step>(random() % 300'000) - 150'000);
    z.push_back(900 * 256 + static_cast<lattice::Step>(random() % 300'000) - 150'000);
    for (const lattice::Step v : {x.back(), z.back()}) {
      const double metres = static_cast<double>(v) * lattice::kMetresPerStep;
      places.append(reinterpret_cast<const char*>(&metres), sizeof metres);
    }
  }
  // The server's.
  SocketClient http(server.port());
  http.send("POST /v1/heights HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/octet-stream\r\nContent-Length: " +
            std::to_string(places.size()) + "\r\n\r\n" + places);
  const std::string answer = http.answer();
  std::vector<float> told(x.size()), own(x.size()), held(x.size());
  ASSERT_EQ(answer.size() - answer.find("\r\n\r\n") - 4, 4 * told.size()) << answer.substr(0, 300);
  std::memcpy(told.data(), &answer[answer.size() - 4 * told.size()], 4 * told.size());
  // Of the file, as every program that links the library has it.
  raster::RasterOptions options;
  for (const std::string& option : how) ASSERT_TRUE(raster::addRasterOption(option, options));
  const auto terrain = raster::loadRaster(map, options, 1).value();
  terrain->heights(x, z, own);
  EXPECT_EQ(told, own);
  // Of the tiles that a client gets, for the march.
  const auto client = link::Client::open(core::parseUrl(server.url()).value(), {}).value();
  const wire::World world = client->world();
  ASSERT_TRUE(world.heightMap);
  EXPECT_EQ(world.heightMap->x.pitch, terrain::pitchOf(800));
  EXPECT_EQ(world.terrainSource, terrain->source());
  core::HeightWindow window(world.terrainName, world.terrainSource, world.seed, *world.heightMap, 1000);
  window.moveTo({500 * 256, 900 * 256});
  ASSERT_TRUE(await([&] { return client->exchangeTiles(window), window.complete(); }));
  window.heights(x, z, held);
  EXPECT_EQ(told, held);
  // And the shader's, in a picture; the mesh of it all is the server's.
  const auto summary = fly(server, {"--no-remote-shaders"});
  EXPECT_EQ(summary["hash_mismatches"], 0);
  EXPECT_GT(summary["ssim_settled"], 0.9) << output_;
}

// A picture of blue and red stripes across the view: the mesh has them where the ray march has them.
TEST_F(TerrainFlight, APictureOnAMapIsDrawn) {
  const std::string map = (folder_ / "map.tif").string(), ortho = (folder_ / "ortho.tif").string();
  writeGeoTiff<std::uint16_t, 1>(map, 400, 400, 10, [](int x, int z) {
    return std::array{static_cast<std::uint16_t>(1500 + 60 * std::sin(x * 0.11) * std::cos(z * 0.07))};
  });
  writeGeoTiff<std::uint8_t, 3>(ortho, 800, 800, 5, [](int, int z) {
    return z / 30 % 2 ? std::array<std::uint8_t, 3>{230, 30, 30} : std::array<std::uint8_t, 3>{30, 30, 230};
  });
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", map, "--drape", ortho});
  const auto summary = fly(server, {"--no-remote-shaders"});
  EXPECT_EQ(summary["hash_mismatches"], 0);
  EXPECT_GT(summary["ssim_settled"], 0.88) << output_;  // stripes at silhouettes
  for (const char* file : {"out/settled-mesh.png", "out/settled-raymarch.png"}) {
    const auto picture = render::readPng(folder_ / file);
    ASSERT_TRUE(picture) << file;
    std::size_t red = 0, blue = 0;
    for (std::size_t k = std::size_t{110} * 320; k < std::size_t{180} * 320; ++k) {
      const std::uint8_t* p = &picture->rgb[3 * k];
      red += p[0] > 2 * p[2];
      blue += p[2] > 2 * p[0];
    }
    EXPECT_GT(red, 4000u) << file;
    EXPECT_GT(blue, 4000u) << file;
    EXPECT_GT(red + blue, 18'000u) << file << ": of 22,400";
  }
}

TEST_F(TerrainFlight, APrivateTerrainsColoursTravelWithItsMesh) {
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", RIDGECAST_PATHS "/../../../common/terrain/tutorial/dunes.glsl", "--terrain-cache",
                                          (folder_ / "cache").string(), "--private-terrain"});
  const auto summary = fly(server);
  EXPECT_EQ(summary["hash_mismatches"], 0);
  EXPECT_TRUE(summary["ssim_settled"].is_null());
  EXPECT_NE(output_.find("come with the mesh"), std::string::npos) << output_;
  const auto picture = render::readPng(folder_ / "out/settled-mesh.png");
  ASSERT_TRUE(picture);
  // Sand: red over green over blue everywhere near the camera.
  std::size_t sand = 0, pixels = 0;
  for (std::size_t y = 120; y < 180; ++y)
    for (std::size_t x = 0; x < 320; ++x, ++pixels) {
      const std::uint8_t* p = &picture->rgb[3 * (y * 320 + x)];
      sand += p[0] > p[1] && p[1] > p[2];
    }
  EXPECT_GT(sand, pixels * 95 / 100);
}

}  // namespace
}  // namespace ridgecast
