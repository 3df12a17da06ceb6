// Worlds that clients make by URL: parameters make another ground, for the mesh, for queries and for whoever joins.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/link/client.h"
#include "common/terrain/terrain.h"
#include "tests/support/flier.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/socket_client.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;
using testing::StartsWith;

constexpr double kPlaces[][2] = {{0, 0}, {333.5, -71}, {1500, 2750.25}, {-4000, 900}};

class Worlds : public testing::Test {
 protected:
  // The tutorial's terrain and a cache of its own: every parameter is compiled here.
  ScratchFolder folder_;
  ServerProcess server_{
      RIDGECAST_SERVER,
      {"--terrain", RIDGECAST_PATHS "/../../../common/terrain/tutorial/dunes.glsl", "--terrain-cache", (folder_ / "cache").string()}};

  std::string get(const std::string& target) {
    const std::string answer = ask(server_.port(), "GET " + target);
    return answer.substr(answer.find("\r\n\r\n") + 4);
  }
  std::vector<double> heights(const std::string& session) {
    std::string target = "/v1/heights?session=" + session;
    for (const auto& [x, z] : kPlaces) target += "&at=" + std::to_string(x) + "," + std::to_string(z);
    return nlohmann::json::parse(get(target)).at("heights").get<std::vector<double>>();
  }
};

TEST_F(Worlds, ParametersMakeAnotherGround) {
  wire::Settings settings;
  settings.threshold = 20;
  Flier flat(server_.url() + "?session=flat&terrain=dunes&seed=1&param=tallest=65", settings);
  Flier high(server_.url() + "?session=high&terrain=dunes&seed=1&param=tallest=1040", settings);
  Flier usual(server_.url() + "?session=usual&terrain=dunes&seed=1&param=tallest=260", settings);
  Flier river(server_.url() + "?session=river&terrain=canyon&seed=1&param=riverLevel=550", settings);
  const auto low = heights("flat"), tall = heights("high"), said = heights("usual"), own = heights("default");
  EXPECT_EQ(said, own);  // what is the default anyway
  for (std::size_t k = 0; k < low.size(); ++k) EXPECT_NEAR(tall[k], 16 * low[k], 1e-3 * std::abs(tall[k]) + 0.01) << k;
  EXPECT_NE(low, tall);
  const auto flooded = heights("river");
  for (const double h : flooded) EXPECT_GE(h, 545);

  // The mesh is of that ground, too.
  camera::Camera camera;
  camera.pose.y = 1300;
  camera.pose.pitch = -0.6;
  for (auto* flier : {&flat, &high}) flier->settle(camera);
  const double true_ = tall[0], held = *high.scene().height({0, 0}), other = *flat.scene().height({0, 0});
  EXPECT_NEAR(held, true_, 0.1 * true_ + 20);
  EXPECT_LT(other, held / 4);

  // Others join by name, or by saying the same; another number is another world, and a refusal says which it is.
  Flier joins(server_.url() + "?session=high", settings),
      repeats(server_.url() + "?session=high&terrain=dunes&param=tallest=1040", settings);
  EXPECT_EQ(joins.world().contentHash, high.world().contentHash);
  EXPECT_EQ(repeats.world().contentHash, high.world().contentHash);
  EXPECT_NE(flat.world().contentHash, high.world().contentHash);
  SocketClient stranger(server_.port());
  EXPECT_FALSE(stranger.upgrade("/v1/stream?session=high&terrain=dunes&param=tallest=1041"));
  EXPECT_THAT(stranger.refusal(), testing::AllOf(StartsWith("HTTP/1.1 409"), HasSubstr("tallest=1040")));

  const auto listed = nlohmann::json::parse(get("/v1/sessions")).at("sessions");
  int found = 0;
  for (const auto& session : listed)
    if (session["name"] == "high") {
      ++found;
      EXPECT_EQ(session["parameters"]["tallest"], 1040.0);
      EXPECT_EQ(session["members"], 3);
    }
  EXPECT_EQ(found, 1);
}

// In an image without a compiler. The same ground from a file that was compiled gives the same meshes.
TEST(WorldsBuiltIn, ParametersNeedNoCompiler) {
  if (!programExists("g++") || !programExists("glslangValidator")) GTEST_SKIP() << "needs g++ and glslangValidator";
  ScratchFolder folder;
  for (const auto& [name, parameter] : {std::pair{"alpine", "snowLine=1500.1"}, {"canyon", "riverLevel=480.3"}}) {
    const auto text =
        std::find_if(terrain::builtIn().begin(), terrain::builtIn().end(), [&](const auto& d) { return d.name == name; })->source;
    const auto copy = folder / ("my-" + std::string(name) + ".glsl");
    std::ofstream(copy) << text;
    const std::string path = getenv("PATH");
    ASSERT_EQ(setenv("PATH", (folder / "empty").c_str(), 1), 0);
    ServerProcess bare(RIDGECAST_SERVER, {"--terrain", name, "--param", parameter, "--terrain-cache", (folder / "none").string()});
    ASSERT_EQ(setenv("PATH", path.c_str(), 1), 0);
    ServerProcess compiler(RIDGECAST_SERVER,
                           {"--terrain", copy.string(), "--param", parameter, "--terrain-cache", (folder / "cache").string()});
    wire::Settings settings;
    settings.threshold = 5;
    Flier own(bare.url(), settings), compiled(compiler.url(), settings);
    EXPECT_EQ(own.world().contentHash, compiled.world().contentHash);
    EXPECT_EQ(own.world().terrainSource, compiled.world().terrainSource);
    camera::Camera camera;
    camera.pose.y = 900;
    camera.pose.pitch = -0.3;
    own.settle(camera);
    compiled.settle(camera);
    EXPECT_EQ(own.step(camera).meshHash, compiled.step(camera).meshHash) << name;
    EXPECT_GT(own.scene().triangles(), 3000u);
  }
}

TEST(WorldsOfAMap, ShareItsSamples) {
  constexpr std::uint64_t kSamples = 4096, kMap = kSamples * kSamples * 4;  // 64 MiB as the server holds it
  ScratchFolder folder;
  {
    std::ofstream out(folder / "map.r16", std::ios::binary);
    std::string row(2 * kSamples, '\0');
    for (std::size_t z = 0; z < kSamples; ++z) {
      for (std::size_t k = 0; k < row.size(); k += 2) row[k] = static_cast<char>(k * z);
      out << row;
    }
  }
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", (folder / "map.r16").string()});
  const auto resident = [&] {
    std::ifstream in("/proc/" + std::to_string(server.process().id()) + "/statm");
    std::uint64_t pages = 0;
    in >> pages >> pages;
    return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
  };
  const std::uint64_t before = resident();
  ASSERT_GT(before, kMap);
  std::vector<std::unique_ptr<SocketClient>> clients;
  for (int k = 0; k < 6; ++k) {
    clients.push_back(std::make_unique<SocketClient>(server.port()));
    ASSERT_TRUE(clients.back()->upgrade("/v1/stream?session=s" + std::to_string(k) + "&terrain=map&seed=" + std::to_string(k)))
        << clients.back()->refusal();
  }
  EXPECT_LE(resident(), before + kMap * 3 / 2);
}

// Maps of one folder, each a session's ground by its name.
class WorldsOfMaps : public testing::Test {
 protected:
  static constexpr const char* kGrid = "ncols 3\nnrows 3\nxllcorner 680000\nyllcorner 5240000\ncellsize 100\n";
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / "new") << text;
    std::filesystem::rename(folder_ / "new", folder_ / name);
  }
  static std::string flat(int height) {
    std::string out = kGrid;
    for (int k = 0; k < 9; ++k) out += std::to_string(height) + (k % 3 == 2 ? "\n" : " ");
    return out;
  }
  static std::string get(const ServerProcess& server, const std::string& target) { return ask(server.port(), "GET " + target); }
  ScratchFolder folder_;
};

TEST_F(WorldsOfMaps, LieBesideOneAnother) {
  write("low.asc", flat(100));
  write("high.asc", flat(900));
  write("high.raster", "offset=50\n");
  write("hole.asc", std::string(kGrid) + "NODATA_value 7\n1 2 3\n4 5 6\n7 8 9\n");
  ServerProcess server(RIDGECAST_SERVER, {"--log-level", "info", "--terrain-dir", std::filesystem::relative(folder_ / "").string()});
  EXPECT_THAT(get(server, "/v1/terrains"), testing::AllOf(HasSubstr("height map, low.asc"), HasSubstr("height map, high.asc")));
  wire::Settings settings;
  settings.threshold = 5;
  camera::Camera camera;
  camera.pose.y = 1500;
  camera.pose.pitch = -1;
  Flier low(server.url() + "?session=a&terrain=low", settings), high(server.url() + "?session=b&terrain=high", settings);
  for (Flier* flier : {&low, &high}) flier->settle(camera);
  EXPECT_NEAR(*low.scene().height({0, 0}), 100, 0.01);
  EXPECT_NEAR(*high.scene().height({0, 0}), 950, 0.01);
  EXPECT_THAT(get(server, "/v1/heights?session=c&terrain=high&at=20,30"), HasSubstr("[950"));
  EXPECT_THAT(get(server, "/v1/heights?session=a&at=20,30"), HasSubstr("[100"));
  EXPECT_THAT(get(server, "/v1/heights?at=20,30"), testing::Not(HasSubstr("[100")));  // the default session's own ground
  const std::string listed = get(server, "/v1/sessions");
  const auto sessions = nlohmann::json::parse(listed.substr(listed.find("\r\n\r\n"))).at("sessions");
  EXPECT_EQ(std::ranges::count_if(sessions, [](const auto& s) { return s.contains("height_map"); }), 3);
  EXPECT_TRUE(await([&] { return server.process().output().find("height map high: 3 x 3 samples, 100 m apart") != std::string::npos; }));
  EXPECT_THAT(get(server, "/v1/heights?session=d&terrain=hole&at=0,0"), HasSubstr("cannot be created: hole.asc: 1 samples are missing"));
  EXPECT_THAT(get(server, "/v1/heights?session=d&terrain=low&param=x=1&at=0,0"), HasSubstr("a height map, which has no parameters"));
  EXPECT_THAT(get(server, "/v1/heights?session=d&terrain=..%2Flow&at=0,0"), HasSubstr("A terrain's name has letters"));
  EXPECT_THAT(get(server, "/v1/heights?session=d&terrain=low.asc&at=0,0"), HasSubstr("A terrain's name has letters"));
}

// --watch: also the files that a map names, and the one that says how it is read.
TEST_F(WorldsOfMaps, FollowTheirSources) {
  if (!programExists("gdal_translate")) GTEST_SKIP() << "needs gdal-bin";
  write("part.asc", flat(100));
  write("whole.vrt", R"(<VRTDataset rasterXSize="3" rasterYSize="3"><GeoTransform>680000, 100, 0, 5240300, 0, -100</GeoTransform>
<VRTRasterBand dataType="Float32" band="1"><SimpleSource><SourceFilename relativeToVRT="1">part.asc</SourceFilename>
<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>)");
  ServerProcess server(RIDGECAST_SERVER, {"--watch", "--terrain-dir", (folder_ / "").string()});
  const auto becomes = [&](const std::string& height, std::chrono::seconds within) {
    return await([&] { return get(server, "/v1/heights?session=w&terrain=whole&at=0,0").find("[" + height) != std::string::npos; }, within);
  };
  ASSERT_TRUE(becomes("100", std::chrono::seconds(60))) << get(server, "/v1/heights?session=w&terrain=whole&at=0,0");
  // Saved again where the server had not yet looked.
  const auto turns = [&](const std::string& name, const std::string& text, const std::string& height) {
    for (int k = 0; k < 20; ++k) {
      write(name, text);
      if (becomes(height, std::chrono::seconds(3))) return true;
    }
    return false;
  };
  EXPECT_TRUE(turns("part.asc", flat(300), "300")) << server.process().output();
  EXPECT_TRUE(turns("whole.raster", "offset=25\n", "325")) << server.process().output();
}

// A compiler that never ends stands first in PATH and notes the id of its process each time it starts.
class SlowCompiler {
 public:
  SlowCompiler() {
    const std::filesystem::path program = folder_ / "g++";
    std::ofstream(program) << "#!/bin/sh\necho $$ >> " << notes().string() << "\nexec sleep 600\n";
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    setenv("PATH", (program.parent_path().string() + ":" + before_).c_str(), 1);
  }
  ~SlowCompiler() { setenv("PATH", before_.c_str(), 1); }
  std::vector<pid_t> started() const {
    std::ifstream in(notes());
    return {std::istream_iterator<pid_t>(in), {}};
  }
  bool runs() const {
    return std::ranges::any_of(started(), [](pid_t id) { return kill(id, 0) == 0; });
  }

 private:
  std::filesystem::path notes() const { return folder_ / "started"; }
  ScratchFolder folder_;
  std::string before_ = std::getenv("PATH");
};

constexpr char kTutorial[] = RIDGECAST_PATHS "/../../../common/terrain/tutorial";
constexpr char kCompiledWorld[] =
    "GET /v1/stream?session=left&terrain=dunes&param=tallest=550 HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\n"
    "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";

TEST(WorldsLeft, HangingUpStopsTheCompilerAndMakesNoSession) {
  const SlowCompiler compiler;
  ScratchFolder folder;
  ServerProcess server(RIDGECAST_SERVER, {"--terrain-dir", kTutorial, "--terrain-cache", (folder / "cache").string()});
  auto client = std::make_unique<SocketClient>(server.port());
  client->send(kCompiledWorld);
  ASSERT_TRUE(await([&] { return compiler.runs(); }));
  client.reset();
  EXPECT_TRUE(await([&] { return !compiler.runs(); }, std::chrono::seconds(20)));
  SocketClient asks(server.port());
  asks.send("GET /v1/sessions HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(asks.answer(), testing::Not(HasSubstr("left")));
  EXPECT_EQ(compiler.started().size(), 1u) << "also without colours";
}

TEST(WorldsLeft, TheServersEndStopsTheCompiler) {
  const SlowCompiler compiler;
  ScratchFolder folder;
  ServerProcess server(RIDGECAST_SERVER, {"--drain", "1", "--terrain-dir", kTutorial, "--terrain-cache", (folder / "cache").string()});
  SocketClient client(server.port());
  client.send(kCompiledWorld);
  ASSERT_TRUE(await([&] { return compiler.runs(); }));
  server.process().signal(SIGTERM);
  EXPECT_EQ(server.process().wait(std::chrono::seconds(20)), 0);
  EXPECT_FALSE(compiler.runs());
  EXPECT_EQ(compiler.started().size(), 1u) << "also without colours";
}

// --watch: what is saved is flown over, once it has no errors.
TEST(WorldsWatched, GoOnWithTheGroundThatWasSaved) {
  ScratchFolder folder;
  std::filesystem::create_directory(folder / "more");
  const auto save = [&](const std::string& file, const std::string& height) {
    // As editors do: a new file takes the place.
    std::ofstream(folder / "new") << "const float extra = 0.0;  //! 0..100 m: more\n"
                                     "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n"
                                     "  return extra + " +
                                         height +
                                         ";\n}\nvec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, "
                                         "uint seed) { return vec3(0.3); }\n";
    std::filesystem::rename(folder / "new", folder / file);
  };
  save("mine.glsl", "40.0");
  save("more/plain.glsl", "70.0");
  ServerProcess server(RIDGECAST_SERVER, {"--watch", "--terrain", (folder / "mine.glsl").string(), "--terrain-dir",
                                          (folder / "more").string(), "--terrain-cache", (folder / "cache").string()});
  wire::Settings settings;
  settings.threshold = 20;
  camera::Camera camera;
  camera.pose.y = 300;
  const auto arrives = [&](const std::string& session) {
    auto flier = std::make_unique<Flier>(server.url() + session, settings);
    flier->settle(camera);
    return flier;
  };
  const auto sentAway = [](Flier& flier) {
    return await([&] { return !flier.take(std::chrono::milliseconds(10)) && flier.connection().error(); }, std::chrono::seconds(60));
  };
  auto own = arrives(""), other = arrives("?session=other&terrain=plain&seed=1&param=extra=5");
  EXPECT_NEAR(*own->scene().height({0, 0}), 40, 0.1);
  EXPECT_NEAR(*other->scene().height({0, 0}), 75, 0.1);

  save("mine.glsl", "90.0");
  ASSERT_TRUE(sentAway(*own)) << server.process().output();
  EXPECT_THAT(own->connection().error()->message, HasSubstr("begins again"));
  const std::uint64_t before = own->world().contentHash;
  own = arrives("");
  EXPECT_NEAR(*own->scene().height({0, 0}), 90, 0.1);
  EXPECT_NE(own->world().contentHash, before);
  EXPECT_NEAR(*other->scene().height({0, 0}), 75, 0.1);
  EXPECT_FALSE(other->connection().error());  // another file's

  save("more/plain.glsl", "20.0");
  ASSERT_TRUE(sentAway(*other)) << server.process().output();
  other = arrives("?session=other");
  EXPECT_NEAR(*other->scene().height({0, 0}), 25, 0.1);  // with its parameter

  // Errors: the old ground stays, the log and the members are told why.
  wire::Hello hello;
  hello.settings = settings;
  hello.members = true;
  const auto member = link::Client::open(core::parseUrl(server.url()).value(), hello).value();
  save("mine.glsl", "heigth");
  ASSERT_TRUE(await([&] { return server.process().output().find("'heigth'") != std::string::npos; }, std::chrono::seconds(60)));
  EXPECT_THAT(server.process().output(),
              testing::AllOf(HasSubstr("keeps its ground"), HasSubstr("mine.glsl:3: 'heigth' : undeclared identifier")));
  EXPECT_TRUE(await([&] {
    member->receive(std::chrono::milliseconds(10));
    return member->connection().clock().notice().find("3: 'heigth' : undeclared") != std::string::npos;
  }));
  camera.pose.x = 500;
  own->settle(camera);
  EXPECT_NEAR(*own->scene().height({0, 0}), 90, 0.1);
  EXPECT_NEAR(*arrives("")->scene().height({0, 0}), 90, 0.1);

  save("mine.glsl", "60.0");
  ASSERT_TRUE(sentAway(*own));
  EXPECT_NEAR(*arrives("")->scene().height({0, 0}), 60, 0.1);
}

}  // namespace
}  // namespace ridgecast
