// `ridgecast-client fly` against the real server: the files it leaves, what they say, and what programs that share no code with it say
// about them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "client/evaluation/ssim.h"
#include "client/render/context.h"
#include "client/render/picture.h"
#include "tests/support/glb_file.h"
#include "tests/support/mesh_check.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using Json = nlohmann::json;

// One flight for all tests: two seconds at 10 iterations a second, a picture each second, an export in its middle.
class Fly : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (auto context = render::HeadlessContext::create(); !context) {
      noGraphics_ = context.error().message;
      return;
    }
    folder_ = std::make_unique<ScratchFolder>();
    server_ = std::make_unique<ServerProcess>(RIDGECAST_SERVER);
    middle_ = fly({"--seconds", "2", "--frames-every", "1", "--export", (*folder_ / "middle.glb").string(), "--export-at", "1"}, "out");
  }
  static void TearDownTestSuite() {
    server_.reset();
    folder_.reset();
  }
  void SetUp() override {
    if (!noGraphics_.empty()) GTEST_SKIP() << noGraphics_;
    ASSERT_EQ(middle_.code, 0) << middle_.output;
  }
  static Finished fly(std::vector<std::string> more, const std::string& out, const std::string& path = "alpine") {
    std::vector<std::string> command{
        RIDGECAST_CLIENT, "fly",     server_->url(), "--path", RIDGECAST_PATHS "/" + path + ".json", "--out", (*folder_ / out).string(),
        "--size",         "320x180", "--threshold",  "0.5"};
    command.insert(command.end(), more.begin(), more.end());
    return runProgram(command);
  }
  static std::filesystem::path file(const std::string& name) { return *folder_ / ("out/" + name); }

  static std::unique_ptr<ScratchFolder> folder_;
  static std::unique_ptr<ServerProcess> server_;
  static Finished middle_;
  static std::string noGraphics_;
};
std::unique_ptr<ScratchFolder> Fly::folder_;
std::unique_ptr<ServerProcess> Fly::server_;
Finished Fly::middle_;
std::string Fly::noGraphics_;

TEST_F(Fly, LeavesTheFilesThatItNames) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(file("").parent_path())) names.push_back(entry.path().filename());
  // Iterations 1 to 21 are made at 0, 0.1, ... 2 s.
  EXPECT_THAT(names, testing::UnorderedElementsAre("0011-mesh.png", "0011-raymarch.png", "0021-mesh.png", "0021-raymarch.png",
                                                   "settled-mesh.png", "settled-raymarch.png", "iterations.jsonl", "summary.json"));
}

TEST_F(Fly, TheSummaryIsSane) {
  const Json s = Json::parse(readText(file("summary.json")));
  EXPECT_EQ(s.at("frames"), 2);
  for (const char* key : {"ssim_mean", "ssim_min", "ssim_settled", "ssim_settled_terrain"}) {
    EXPECT_GT(s.at(key).get<double>(), 0.6) << key;
    EXPECT_LT(s.at(key).get<double>(), 1) << key;
  }
  EXPECT_LE(s.at("ssim_min"), s.at("ssim_mean"));
  EXPECT_GT(s.at("ssim_settled").get<double>(), 0.8);
  EXPECT_GT(s.at("terrain_share").get<double>(), 0.6);
  EXPECT_LE(s.at("terrain_share").get<double>(), 1);
  EXPECT_GT(s.at("triangles").get<std::uint64_t>(), 10'000u);
  EXPECT_LE(s.at("triangles").get<std::uint64_t>(), 500'000u);
  for (const char* key : {"iterations_per_second", "mesh_frame_ms", "raymarch_frame_ms", "bytes_received"})
    EXPECT_GT(s.at(key).get<double>(), 0) << key;
  EXPECT_EQ(s.at("hash_mismatches"), 0);
  EXPECT_EQ(s.at("settled"), true);
  EXPECT_EQ(s.at("pacing"), "lockstep");
  EXPECT_EQ(s.at("width"), 320);
}

TEST_F(Fly, EveryIterationIsOneLine) {
  std::istringstream lines(readText(file("iterations.jsonl")));
  std::uint64_t number = 0, bytes = 0;
  for (std::string line; std::getline(lines, line);) {
    const Json i = Json::parse(line);
    EXPECT_EQ(i.at("iteration"), ++number);
    EXPECT_EQ(i.at("hash_ok"), true);
    for (const char* key : {"select_ms", "generate_ms", "refine_ms", "triangulate_ms", "encode_ms", "inserted", "leaves"})
      EXPECT_GE(i.at(key).get<double>(), 0) << key;
    EXPECT_GT(i.at("triangles").get<std::uint64_t>(), 0u);
    bytes += i.at("bytes").get<std::uint64_t>();
  }
  const Json s = Json::parse(readText(file("summary.json")));
  EXPECT_EQ(s.at("iterations"), number);
  EXPECT_GT(number, 21u);  // the path's, and those until it was at rest
  EXPECT_GE(s.at("bytes_received").get<std::uint64_t>(), bytes);
}

TEST_F(Fly, ThePicturesShowSomething) {
  for (const char* name : {"0011-mesh.png", "0021-raymarch.png", "settled-mesh.png", "settled-raymarch.png"}) {
    const auto picture = render::readPng(file(name));
    ASSERT_TRUE(picture) << name;
    EXPECT_EQ(picture->width, 320u);
    EXPECT_EQ(picture->height, 180u);
    const auto [low, high] = std::minmax_element(picture->rgb.begin(), picture->rgb.end());
    EXPECT_GT(*high - *low, 100) << name;
  }
}

TEST_F(Fly, TheSimilarityIsThatOfThePicturesWritten) {
  const auto mesh = render::readPng(file("settled-mesh.png")), march = render::readPng(file("settled-raymarch.png"));
  ASSERT_TRUE(mesh && march);
  const Json s = Json::parse(readText(file("summary.json")));
  EXPECT_NEAR(s.at("ssim_settled").get<double>(), evaluation::similarity(*mesh, *march).mean, 1e-9);
}

// The same flight gives the same pictures and figures, byte for byte.
TEST_F(Fly, IsRepeatable) {
  ASSERT_EQ(fly({"--seconds", "2", "--frames-every", "1"}, "again").code, 0);
  for (const char* name : {"0011-mesh.png", "0021-mesh.png", "settled-mesh.png", "settled-raymarch.png"})
    EXPECT_EQ(readText(file(name)), readText(*folder_ / ("again/" + std::string(name)))) << name;
}

TEST_F(Fly, ExportsPassTheIndependentCheck) {
  const auto expectSound = [&](const std::string& glb) {
    const MeshReport report = checkMesh(readGlb(readText(*folder_ / glb)).meshes());
    EXPECT_TRUE(report.clean()) << glb << ": " << report.text();
  };
  expectSound("middle.glb");
  for (const std::string path : {"alpine", "alpine-1e8", "alpine-1e12"}) {
    const Finished flown = fly({"--seconds", "1", "--frames-every", "9", "--export", (*folder_ / (path + ".glb")).string()}, path, path);
    ASSERT_EQ(flown.code, 0) << flown.output;
    expectSound(path + ".glb");
  }
}

TEST_F(Fly, ByTheClock) {
  const Finished flown = fly({"--seconds", "2", "--frames-every", "9", "--realtime"}, "realtime");
  ASSERT_EQ(flown.code, 0) << flown.output;
  const Json s = Json::parse(readText(*folder_ / "realtime/summary.json"));
  EXPECT_EQ(s.at("pacing"), "realtime");
  EXPECT_EQ(s.at("hash_mismatches"), 0);
  EXPECT_EQ(s.at("settled"), true);
  EXPECT_GT(s.at("ssim_settled").get<double>(), 0.8);
}

// What came before and after is one flight: the mesh is kept, and at the end all of it is the server's.
TEST_F(Fly, ByTheClockGoesOnWhenTheServerIsKilledAndComesBack) {
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER);
  const std::uint16_t port = server->port();
  Process flight({RIDGECAST_CLIENT, "fly", server->url(), "--path", RIDGECAST_PATHS "/alpine.json", "--out", (*folder_ / "back").string(),
                  "--size", "64x48", "--threshold", "3", "--seconds", "8", "--frames-every", "99", "--realtime"});
  const auto says = [&](const std::string& text) { return await([&] { return flight.output().find(text) != std::string::npos; }); };
  ASSERT_TRUE(says("iteration ")) << flight.output();
  server->process().signal(SIGKILL);
  server->process().wait(kTimeout);
  ASSERT_TRUE(says("; trying again")) << flight.output();
  server = std::make_unique<ServerProcess>(RIDGECAST_SERVER, std::vector<std::string>{}, port);
  ASSERT_EQ(flight.wait(kTimeout), 0) << flight.output();
  const Json s = Json::parse(readText(*folder_ / "back/summary.json"));
  EXPECT_EQ(s.at("reconnections"), 1);
  EXPECT_EQ(s.at("hash_mismatches"), 0);
  EXPECT_EQ(s.at("settled"), true);
  EXPECT_TRUE(server->healthy());
}

// --watch: what the author saves is entered, on the way and at the end.
TEST_F(Fly, ByTheClockEntersTheGroundThatWasSaved) {
  if (!programExists("g++") || !programExists("glslangValidator")) GTEST_SKIP() << "needs g++ and glslangValidator";
  const auto save = [](const std::string& height) {
    std::ofstream(*folder_ / "new") << "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return " << height
                                    << "; }\nvec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, "
                                       "uint seed) { return vec3(0.3); }\n";
    std::filesystem::rename(*folder_ / "new", *folder_ / "mine.glsl");
  };
  save("40.0");
  const ServerProcess server(RIDGECAST_SERVER,
                             {"--watch", "--terrain", *folder_ / "mine.glsl", "--terrain-cache", (*folder_ / "cache").string()});
  const auto glb = *folder_ / "watched.glb";
  Process flight({RIDGECAST_CLIENT, "fly", server.url(), "--path", RIDGECAST_PATHS "/alpine.json", "--out", (*folder_ / "watched").string(),
                  "--size", "64x48", "--threshold", "3", "--seconds", "12", "--frames-every", "99", "--realtime", "--export",
                  glb.string()});
  const auto says = [&](const std::string& text) { return await([&] { return flight.output().find(text) != std::string::npos; }); };
  EXPECT_TRUE(says("the graphics driver compiles terrain mine")) << flight.output();
  ASSERT_TRUE(says("iteration ")) << flight.output();
  save("90.0");
  EXPECT_TRUE(says("another world now; entering it")) << flight.output();
  ASSERT_EQ(flight.wait(kTimeout), 0) << flight.output();
  const Json s = Json::parse(readText(*folder_ / "watched/summary.json"));
  EXPECT_EQ(s.at("hash_mismatches"), 0);
  EXPECT_EQ(s.at("settled"), true);
  for (const mesh::LeafMesh& leaf : readGlb(readText(glb)).meshes())
    for (const mesh::LocalVertex& v : leaf.vertices) ASSERT_NEAR(v.y, 90 * 256, 2048) << "the old ground";  // far ones are snapped
}

TEST_F(Fly, InLockStepALostServerIsTheEnd) {
  auto server = std::make_unique<ServerProcess>(RIDGECAST_SERVER);
  Process flight({RIDGECAST_CLIENT, "fly", server->url(), "--path", RIDGECAST_PATHS "/alpine.json", "--out", (*folder_ / "lost").string(),
                  "--size", "64x48", "--frames-every", "99"});
  ASSERT_TRUE(await([&] { return flight.output().find("iteration ") != std::string::npos; })) << flight.output();
  server->process().signal(SIGKILL);
  EXPECT_EQ(flight.wait(kTimeout), 1) << flight.output();
}

TEST_F(Fly, APictureOfAPose) {
  const auto take = [](const std::string& drawn, std::vector<std::string> more = {}, bool ownServer = false) {
    const std::string out = *folder_ / (drawn + ".png");
    std::vector<std::string> command{RIDGECAST_CLIENT, "picture"};
    const std::vector<std::string> from = ownServer ? std::vector<std::string>{"--terrain", "alpine"} : std::vector{server_->url()};
    command.insert(command.end(), from.begin(), from.end());
    for (const std::string word : {"--out", out.c_str(), "--x", "2000", "--z", "1500", "--altitude", "60", "--pitch", "-5", "--size",
                                   "320x180", "--draw", drawn.c_str(), "--threshold", "2"})
      command.push_back(word);
    command.insert(command.end(), more.begin(), more.end());
    const Finished taken = runProgram(command, {{"TMPDIR", (*folder_ / "").string()}});
    EXPECT_EQ(taken.code, 0) << taken.output;
    return render::readPng(out);
  };
  const auto corrected = take("corrected"), mesh = take("mesh"), march = take("march"), elsewhere = take("march", {"--yaw", "90"});
  ASSERT_TRUE(corrected && mesh && march && elsewhere);
  EXPECT_EQ(corrected->width, 320u);
  EXPECT_EQ(corrected->height, 180u);
  const double ofCorrected = evaluation::similarity(*corrected, *march).mean, ofMesh = evaluation::similarity(*mesh, *march).mean;
  EXPECT_GT(ofCorrected, 0.98);
  EXPECT_GT(ofMesh, 0.6);
  EXPECT_GT(ofCorrected, ofMesh);
  EXPECT_LT(evaluation::similarity(*elsewhere, *march).mean, ofMesh);
  const auto own = take("mesh", {}, true);  // of a server of its own, which ends with it
  ASSERT_TRUE(own);
  EXPECT_EQ(own->rgb, mesh->rgb);
  for (const auto& left : std::filesystem::directory_iterator(*folder_ / ""))
    EXPECT_EQ(left.path().filename().string().find("ridgecast-picture"), std::string::npos) << left.path();
}

TEST_F(Fly, APictureBeginsOnAMapThatLiesElsewhere) {
  const std::string map = *folder_ / "elsewhere.asc", out = *folder_ / "elsewhere.png";
  std::ofstream(map) << "ncols 3\nnrows 2\nxllcorner 680000\nyllcorner 5240000\ncellsize 100\n10 90 30\n40 0 160\n";
  const auto take = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command{RIDGECAST_CLIENT, "picture", "--terrain", map,     "--raster",    "place=geo", "--out", out,
                                     "--draw",         "mesh",    "--size",    "64x48", "--threshold", "20"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished taken = runProgram(command);
    EXPECT_EQ(taken.code, 0) << taken.output;
    return render::readPng(out).value().rgb;
  };
  const auto middle = take({});
  EXPECT_EQ(middle, take({"--x", "680150", "--z", "-5240050"}));
  EXPECT_NE(middle, take({"--x", "0"}));
}

TEST_F(Fly, WarnsOfAnotherTerrainAndFliesOn) {
  ServerProcess other(RIDGECAST_SERVER, {"--seed", "7"});
  const Finished flown = runProgram({RIDGECAST_CLIENT, "fly", other.url(), "--path", RIDGECAST_PATHS "/alpine.json", "--out",
                                     (*folder_ / "seed7").string(), "--size", "64x48", "--seconds", "0.3", "--settle-limit", "0"});
  EXPECT_EQ(flown.code, 0) << flown.output;
  EXPECT_THAT(flown.output, testing::HasSubstr("warning: the path was made for terrain alpine, seed 1"));
}

}  // namespace
}  // namespace ridgecast
