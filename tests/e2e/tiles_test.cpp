// 3D Tiles from the real server: random tiles keep their error against its own heights, lie where the tileset says, and pass Khronos'
// validators. TILES is the number of tiles; a release is judged with 10,000.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "common/lattice/lattice.h"
#include "server/access/crypto.h"
#include "tests/e2e/gltf_validator.h"
#include "tests/support/geo_tiff.h"
#include "tests/support/glb_file.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::StartsWith;
using Json = nlohmann::json;

constexpr int kAcross = 31;  // places along a tile's side; their squares are less than what one question may hold
constexpr char kFolder[] = "/v1/sessions/default/3dtiles/";

struct Response {
  std::string head, body;
};

Response ask(const ServerProcess& server, const std::string& target, const std::string& more = "") {
  SocketClient client(server.port());
  client.send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n" + more + "\r\n");
  const std::string all = client.answer();
  const auto end = all.find("\r\n\r\n");
  return end == std::string::npos ? Response{} : Response{all.substr(0, end + 2), all.substr(end + 4)};
}

std::string resolved(std::string folder, std::string uri) {
  for (; uri.starts_with("../"); uri.erase(0, 3)) folder.erase(folder.rfind('/', folder.size() - 2) + 1);
  return folder + uri;
}

// A random way from the root down to a tile, by the URIs alone.
struct Walk {
  const ServerProcess& server;
  std::mt19937_64& random;
  double x = 0, y = 0;  // metres from the root's origin to the tile's frame

  Json tileFrom(const std::string& query, std::string& uri) {
    std::string target = kFolder + ("tileset.json?" + query);
    for (;;) {
      const Response r = ask(server, target);
      EXPECT_THAT(r.head, StartsWith("HTTP/1.1 200")) << target << r.body;
      const std::string folder = target.substr(0, target.substr(0, target.find('?')).rfind('/') + 1);
      Json tile = Json::parse(r.body)["root"];
      for (bool first = true;; first = false) {
        if (const auto t = tile.find("transform"); t != tile.end()) {
          x += (*t)[12].get<double>();
          y += (*t)[13].get<double>();
        }
        if (tile.contains("content")) uri = resolved(folder, tile["content"]["uri"]);
        if (!tile.contains("children") || (!first && random() % 3 == 0)) break;
        const Json& children = tile["children"];
        tile = Json(children[random() % children.size()]);
      }
      if (uri.find(".glb") != std::string::npos) return tile;
      target = uri;
    }
  }
};

// The greatest distance between the tile and the server's heights, over a grid of places within it.
double deviation(const ServerProcess& server, const mesh::LeafMesh& mesh, std::mt19937_64& random) {
  const double side = static_cast<double>(mesh.address.side());
  std::vector<double> x, z;
  std::string query;
  for (int i = 0; i < kAcross; ++i)
    for (int j = 0; j < kAcross; ++j) {
      const auto inside = [&](int k) { return std::floor((k + static_cast<double>(random() % 1000) / 1000) / kAcross * side); };
      x.push_back(inside(i));
      z.push_back(inside(j));
      char place[80];
      std::snprintf(place, sizeof place, "&at=%.8f,%.8f", (static_cast<double>(mesh.address.x()) + x.back()) / 256,
                    (static_cast<double>(mesh.address.z()) + z.back()) / 256);
      query += place;
    }
  std::vector<double> height;
  for (std::size_t from = 0; from < query.size();) {  // as long as a request's header may be
    std::size_t to = query.size();
    if (to - from > 7000) to = query.rfind("&at=", from + 7000);
    const Response r = ask(server, "/v1/heights?" + query.substr(from + 1, to - from - 1));
    EXPECT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
    const Json answer = Json::parse(r.body);
    for (const Json& h : answer["heights"]) height.push_back(h);
    from = to;
  }
  EXPECT_EQ(height.size(), x.size());
  std::vector<double> found(x.size(), 1e9);
  for (const mesh::Triangle& t : mesh.triangles) {
    const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const auto [lowX, highX] = std::minmax({a.x, b.x, c.x});
    const auto [lowZ, highZ] = std::minmax({a.z, b.z, c.z});
    const double area = (double(b.z) - a.z) * (double(c.x) - a.x) - (double(b.x) - a.x) * (double(c.z) - a.z);
    for (std::size_t k = 0; k < x.size(); ++k) {
      if (x[k] < lowX || x[k] > highX || z[k] < lowZ || z[k] > highZ) continue;
      const auto weight = [&](const mesh::LocalVertex& p, const mesh::LocalVertex& q) {
        return ((double(p.z) - z[k]) * (double(q.x) - x[k]) - (double(p.x) - x[k]) * (double(q.z) - z[k])) / area;
      };
      const double wa = weight(c, b), wb = weight(a, c), wc = weight(b, a);
      const double sum = wa + wb + wc;
      if (std::min({wa / sum, wb / sum, wc / sum}) < -1e-9) continue;
      found[k] = std::min(found[k], std::abs((wa * a.y + wb * b.y + wc * c.y) / sum / 256 - height[k]));
    }
  }
  return *std::ranges::max_element(found);
}

// Rough hills: noise of six widths, 16 bits a sample.
void writeMap(const std::string& file) {
  std::ofstream out(file, std::ios::binary);
  const auto noise = [](int x, int z) { return static_cast<double>(lattice::mix(static_cast<unsigned>(x * 7919 + z)) % 1000) / 1000; };
  for (int z = 0; z < 500; ++z)
    for (int x = 0; x < 700; ++x) {
      double height = 0;
      for (int bits = 1; bits <= 6; ++bits) {
        const int i = x >> bits, j = z >> bits, width = 1 << bits;
        const double u = static_cast<double>(x % width) / width, v = static_cast<double>(z % width) / width;
        const double north = noise(i, j) * (1 - u) + noise(i + 1, j) * u, south = noise(i, j + 1) * (1 - u) + noise(i + 1, j + 1) * u;
        height += 40 * width * (north * (1 - v) + south * v);
      }
      const auto sample = static_cast<unsigned>(height);
      out.put(static_cast<char>(sample & 255)).put(static_cast<char>(sample >> 8));
    }
}

// 10 m apart.
void writeHills(const std::string& file, std::uint16_t width, std::uint16_t height) {
  writeGeoTiff<std::uint16_t, 1>(file, width, height, 10, [](int x, int z) {
    return std::array{static_cast<std::uint16_t>(1500 + 200 * std::sin(x * 0.11) * std::cos(z * 0.07))};
  });
}

std::string readFile(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

int wanted(int usual) {
  const char* set = std::getenv("TILES");
  return set ? std::atoi(set) : usual;
}

TEST(Tiles, RandomOnesKeepTheirErrorWhereverTheyLie) {
  std::mt19937_64 random(11);
  const int tiles = wanted(20);
  ScratchFolder folder;
  const std::string map = folder / "map.r16";
  writeMap(map);
  const std::string detailed = folder / "detailed.r16";
  writeMap(detailed);
  for (const std::string& terrain : {std::string("alpine"), std::string("canyon"), std::string("archipelago"), map, detailed}) {
    std::vector<std::string> arguments{"--terrain", terrain, "--max-snapshot-seconds", "600"};
    if (terrain == map || terrain == detailed)
      for (const char* how : {"size=700x500", "pitch=5", "scale=0.05", "edge=mirror"}) arguments.insert(arguments.end(), {"--raster", how});
    if (terrain == detailed) arguments.insert(arguments.end(), {"--raster", "detail=alpine:0.5:4"});
    ServerProcess server(RIDGECAST_SERVER, arguments);
    std::vector<double> share, milliseconds, again, bytes;
    for (int k = 0; k < tiles / 4; ++k) {
      Walk walk{server, random};
      std::string uri;
      const double x = k % 2 ? 1e9 : 0, z = k % 4 > 1 ? -1e9 : 0;
      const std::string where = "reach=100000&x=" + std::to_string(x) + "&z=" + std::to_string(z) + (k % 3 ? "" : "&compression=draco");
      const Json tile = walk.tileFrom(where, uri);
      const auto timed = [&](std::vector<double>& into) {
        const auto begin = std::chrono::steady_clock::now();
        const Response r = ask(server, uri);
        into.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
        EXPECT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
        return r.body;
      };
      const std::string body = timed(milliseconds);
      EXPECT_EQ(timed(again), body);
      bytes.push_back(static_cast<double>(body.size()));
      const GlbFile file = readGlb(body);
      ASSERT_EQ(file.leaves.size(), 2u);
      EXPECT_EQ(file.json["nodes"][0]["name"], "surface");
      EXPECT_EQ(file.json["nodes"][1]["name"], "skirt");
      const mesh::LeafMesh& surface = file.leaves[0].mesh;
      // Where the tileset puts it is where the lattice has it.
      EXPECT_NEAR(walk.x + file.leaves[0].translation[0] + x, static_cast<double>(surface.address.x()) / 256, 1e-6);
      EXPECT_NEAR(-walk.y + file.leaves[0].translation[2] + z, static_cast<double>(surface.address.z()) / 256, 1e-6);
      const double error = tile["geometricError"];
      EXPECT_LE(file.json["asset"]["extras"]["error"]["kept"].get<double>(), error);
      share.push_back(deviation(server, surface, random) / error);
      EXPECT_LE(share.back(), 1) << terrain << " " << uri;
    }
    const auto at = [](std::vector<double>& of, double part) {
      std::sort(of.begin(), of.end());
      return of[static_cast<std::size_t>(part * static_cast<double>(of.size() - 1))];
    };
    std::cout << terrain << ": " << share.size() << " tiles, deviation / geometricError at most " << at(share, 1) << "; ms p50 "
              << at(milliseconds, 0.5) << ", p95 " << at(milliseconds, 0.95) << "; from the cache p95 " << at(again, 0.95) << "; bytes p50 "
              << at(bytes, 0.5) << ", p95 " << at(bytes, 0.95) << "\n";
    EXPECT_EQ(server.stop(), 0) << server.process().output();
  }
}

TEST(Tiles, ATokenOfTheUrlIsHandedOnAndNotLogged) {
  ScratchFolder folder;
  const std::string secret = folder / "secret";
  std::ofstream(secret) << "a secret of an end-to-end test that is long enough\n";
  const auto token = [&](const std::string& rights) {
    Finished made = runProgram({RIDGECAST_SERVER, "token", "--jwt-secret-file", secret, "--rights", rights, "--expires", "1h"});
    EXPECT_EQ(made.code, 0) << made.output;
    return made.output.substr(0, made.output.find('\n'));
  };
  const std::string good = token("snapshot"), weak = token("view");
  ServerProcess server(RIDGECAST_SERVER, {"--jwt-secret-file", secret, "--log-level", "info", "--log-format", "json"});
  std::mt19937_64 random(3);
  std::string uri;
  Walk{server, random}.tileFrom("reach=500&token=" + good, uri);
  EXPECT_THAT(uri, testing::HasSubstr("?token=" + good + "&content="));
  EXPECT_THAT(ask(server, uri).head, StartsWith("HTTP/1.1 200"));
  uri.replace(uri.find(good), good.size(), weak);
  EXPECT_THAT(ask(server, uri).head, StartsWith("HTTP/1.1 403"));
  EXPECT_EQ(server.stop(), 0);
  const std::string log = server.process().output();
  EXPECT_THAT(log, testing::HasSubstr("/3dtiles/"));
  for (const std::string& one : {good, weak}) EXPECT_EQ(log.find(one.substr(one.rfind('.'))), std::string::npos);
}

TEST(Tiles, FillAFolderWithoutAServer) {
  ScratchFolder folder;
  const std::string map = folder / "map.tif";
  writeHills(map, 150, 100);
  const auto shoot = [&](std::vector<std::string> more) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot", "--terrain"};
    command.insert(command.end(), more.begin(), more.end());
    return runProgram(command);
  };
  const std::filesystem::path tiles = folder / "of/map", alpine = folder / "alpine";
  Finished done = shoot({map, "--box", "all", "--error", "0.5", "--tiles", tiles});
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_THAT(done.output, testing::HasSubstr("tileset.json: "));
  const Json set = Json::parse(readFile(tiles / "tileset.json"));
  EXPECT_EQ(set["asset"]["extras"]["georeference"]["crs"], "EPSG:32632");
  EXPECT_TRUE(set["root"].contains("transform"));
  done = shoot({map, "--box", "all", "--tiles", tiles});
  EXPECT_EQ(done.code, 2) << done.output;
  EXPECT_THAT(done.output, testing::HasSubstr("is not empty; name a new folder"));

  done = shoot({"alpine", "--box", "0,0,600,600", "--error", "3.2", "--draco", "--tiles", alpine});
  EXPECT_EQ(done.code, 0) << done.output;
  ServerProcess server(RIDGECAST_SERVER);
  for (const std::string tile : {"3/1/0.glb", "4/0/0.glb"})
    EXPECT_EQ(readFile(alpine / tile), ask(server, kFolder + tile + "?compression=draco").body);

  // What takes a second says how far it is.
  done = shoot({"alpine", "--box", "0,0,6000,6000", "--error", "3.2", "--tiles", folder / "many"});
  EXPECT_EQ(done.code, 0) << done.output;
  EXPECT_THAT(done.output, testing::HasSubstr("meshing, tile "));
  std::filesystem::remove_all(folder / "many");

  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder / ""))
    if (entry.path().extension() == ".glb") files.push_back(entry.path());
  EXPECT_GT(files.size(), 10u);
  validateGltf(files);
}

// Where the map's easting and northing are 0, a thousand kilometres away, there is nothing to see.
TEST(Tiles, OfAMapThatLiesAtItsEastingAndNorthingBeginThere) {
  ScratchFolder folder;
  const std::string map = folder / "map.tif";
  writeHills(map, 150, 100);
  const auto rootOf = [&](const std::string& place, const std::string& query) {
    const ServerProcess server(RIDGECAST_SERVER, {"--terrain", map, "--raster", "place=" + place});
    const Response r = ask(server, kFolder + ("tileset.json?reach=1000&heights=ellipsoid" + query));
    EXPECT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
    return Json::parse(r.body)["root"]["transform"].get<std::vector<double>>();
  };
  const std::vector<double> centred = rootOf("centre", ""), geo = rootOf("geo", ""), zero = rootOf("geo", "&x=0.01");
  for (const std::size_t k : {12, 13, 14}) EXPECT_NEAR(geo.at(k), centred.at(k), 10) << "as far as a sample";
  EXPECT_NEAR(geo.at(14), 4'660'000, 20'000) << "47 degrees north";
  EXPECT_NEAR(zero.at(14), 0, 20'000) << "who asks for another place gets it";
}

// What the format's own library reads of it is what a server answers.
TEST(Tiles, ForWebMapsFillOneFile) {
  if (!std::getenv("TESTS_NODE_TOOLS") || !programExists("node")) GTEST_SKIP() << "no node, or no TESTS_NODE_TOOLS with pmtiles";
  ScratchFolder folder;
  const std::string map = folder / "map.tif", file = folder / "map.pmtiles";
  writeHills(map, 150, 100);
  const auto judge = [&](const std::string& terrain, std::vector<std::string> more, const std::string& layer, const std::string& query,
                         int finest) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot", "--terrain", terrain, "--tiles", file};
    command.insert(command.end(), more.begin(), more.end());
    Finished done = runProgram(command);
    ASSERT_EQ(done.code, 0) << done.output;
    done = runProgram({"node", RIDGECAST_TOOLS "/read-pmtiles.mjs", file});
    ASSERT_EQ(done.code, 0) << done.output;
    const Json read = Json::parse(done.output);
    EXPECT_EQ(read["header"]["maxZoom"], finest);
    EXPECT_TRUE(read["header"]["clustered"]);
    EXPECT_EQ(read["metadata"]["ridgecast"]["seed"], 1);
    ServerProcess server(RIDGECAST_SERVER, {"--terrain", terrain});
    const std::string ending = layer == "heights" ? ".png" : ".jpg";
    std::size_t there = 0;
    for (const auto& [tile, hash] : read["tiles"].items()) {
      const Response r = ask(server, "/v1/sessions/default/" + layer + "/" + tile + ending + "?beyond=empty" + query);
      EXPECT_THAT(r.head, StartsWith(hash.is_null() ? "HTTP/1.1 204" : "HTTP/1.1 200")) << tile;
      if (hash.is_null()) continue;
      EXPECT_EQ(hash, access::hex(access::sha256(r.body))) << tile;
      ++there;
    }
    EXPECT_EQ(there, read["header"]["numAddressedTiles"].get<std::size_t>());
    EXPECT_GE(there, static_cast<std::size_t>(finest));
  };
  judge(map, {"--box", "all"}, "heights", "", 14);
  judge(map, {"--box", "all", "--zoom", "16", "--layer", "colours"}, "colours", "", 16);
  judge("alpine", {"--box", "-400,-300,500,200", "--at", "11.39,47.27", "--zoom", "16"}, "heights", "&at=11.39,47.27", 16);
  for (const auto& [wrong, sentence] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"alpine", "--box", "0,0,9,9", "--zoom", "3"}, "does not say where on Earth it lies"},
           {{"alpine", "--box", "0,0,9,9", "--at", "1,2"}, "whole number from 0 to 24"},
           {{map, "--box", "all", "--zoom", "24"}, "more than 250000 tiles, the limit; zoom=23 fits"},
           {{map, "--box", "all", "--at", "1,2,3"}, "it must be LON,LAT"}}) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot", "--tiles", folder / "none.pmtiles", "--terrain"};
    command.insert(command.end(), wrong.begin(), wrong.end());
    const Finished done = runProgram(command);
    EXPECT_NE(done.code, 0);
    EXPECT_THAT(done.output, testing::HasSubstr(sentence));
    EXPECT_FALSE(std::filesystem::exists(folder / "none.pmtiles"));
  }
}

// A picture of five broad stripes, each of another colour: 6 m a pixel, over the western three quarters of a map.
TEST(Tiles, AndSnapshotsShowThePictureOnAMap) {
  ScratchFolder folder;
  const std::string map = folder / "map.tif", ortho = folder / "ortho.tif", glb = folder / "a.glb", textured = folder / "b.glb";
  constexpr std::array<std::array<std::uint8_t, 3>, 5> kStripes{{{255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {255, 255, 0}, {0, 255, 255}}};
  writeHills(map, 160, 100);
  writeGeoTiff<std::uint8_t, 3>(ortho, 200, 167, 6, [&](int x, int) { return kStripes.at(static_cast<std::size_t>(x / 40)); });
  const auto shoot = [&](std::vector<std::string> more) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "snapshot", "--terrain", map, "--drape", ortho, "--box", "all", "--error", "0.5"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished done = runProgram(command);
    EXPECT_EQ(done.code, 0) << done.output;
  };
  std::array<int, 6> seen{};
  const auto judge = [&](const std::string& file) {
    for (const GlbLeaf& leaf : readGlb(readFile(file)).leaves)
      for (const auto& [place, colour] : leaf.colours) {
        // The map's first sample, at x -800, is the middle of a pixel of 10 m whose corner is the picture's.
        const double fromWest = leaf.translation[0] + static_cast<double>(place.x) / 256 + 800 + 5;
        const auto stripe = static_cast<std::size_t>(fromWest / 240);
        if (std::abs(fromWest - 240 * std::round(fromWest / 240)) < 100) continue;  // colours are means of their triangles' width
        ++seen.at(std::min<std::size_t>(stripe, 5));
        for (std::size_t c = 0; stripe < 5 && c < 3; ++c) EXPECT_NEAR(colour[c], kStripes.at(stripe)[c] / 255.0, 0.1) << fromWest;
      }
  };
  shoot({"--out", glb, "--origin", "world"});
  judge(glb);
  for (const int vertices : seen) EXPECT_GT(vertices, 10);
  shoot({"--out", textured, "--texture", "512"});
  EXPECT_GT(readFile(textured).size(), readFile(glb).size());
  shoot({"--tiles", folder / "tiles"});
  validateGltf({glb, textured});

  ServerProcess server(RIDGECAST_SERVER, {"--watch", "--log-level", "info", "--terrain", map, "--drape", ortho});
  const auto isRenewed = [&] { return server.process().output().find("has new ground") != std::string::npos; };
  const auto save = [&] {
    writeGeoTiff<std::uint8_t, 3>(folder / "new.tif", 100, 80, 12, [&](int, int) { return kStripes[0]; });
    std::filesystem::rename(folder / "new.tif", ortho);
    return await(isRenewed, std::chrono::seconds(2));  // again, if the server had not yet looked
  };
  EXPECT_TRUE(await(save, std::chrono::seconds(60)));

  const Finished refused = runProgram({RIDGECAST_SERVER, "--terrain", "alpine", "--drape", ortho});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.output, testing::HasSubstr("--raster, --drape and --classes are for height maps"));
}

TEST(Tiles, OtherProgramsFindNoFault) {
  ServerProcess server(RIDGECAST_SERVER);
  ScratchFolder folder;
  std::vector<std::string> files;
  for (const char* tile : {"12/0/0", "8/-3/2", "5/4000000/-7", "0/1/1"})
    for (const char* form : {"?compression=draco", "?compression=none", "?normals=0&colours=0", "?compression=draco&materials=1"}) {
      const Response r = ask(server, kFolder + std::string(tile) + ".glb" + form);
      ASSERT_THAT(r.head, StartsWith("HTTP/1.1 200")) << r.body;
      files.push_back(folder / (std::to_string(files.size()) + ".glb"));
      std::ofstream(files.back(), std::ios::binary) << r.body;
    }
  validateGltf(files);
}

}  // namespace
}  // namespace ridgecast
