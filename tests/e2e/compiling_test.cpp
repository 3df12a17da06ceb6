// What a window does while the driver or the server compiles a terrain, and where the driver rejects it.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/e2e/window.h"
#include "tests/support/flier.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

class Window : public WindowTest {};

const Environment kUncached{{"MESA_SHADER_CACHE_DISABLE", "true"}};

// Of red, over a row below the horizon.
double range(const render::Picture& picture) {
  double least = 255, most = 0;
  for (std::uint32_t column = 0; column < picture.width; column += 4) {
    const double v = picture.rgb[3 * (std::size_t{140} * picture.width + column)];
    least = std::min(least, v);
    most = std::max(most, v);
  }
  return most - least;
}

TEST_F(Window, ATerrainThatTheDriverRejectsIsToldAndTheMeshIsStillShown) {
  // Sound for itself, and so for the server; but the ray march has a function of this name already.
  std::string text = readText(RIDGECAST_PATHS "/../../../common/terrain/tutorial/dunes.glsl");
  ASSERT_FALSE(text.empty());
  text += "\nfloat marchHeight(vec2 offset) { return offset.x; }\n";
  std::ofstream(folder_ / "clash.glsl") << text;
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", (folder_ / "clash.glsl").string(), "--terrain-cache", (folder_ / "cache").string()});
  open({"--threshold", "8", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  EXPECT_TRUE(says("marchHeight")) << viewer_->output();  // once the driver has compiled it beside
  EXPECT_NE(viewer_->output().find("neutral colours", viewer_->output().find("marchHeight")), std::string::npos) << viewer_->output();
  press({"f"});
  EXPECT_GT(range(rested()), 10) << "no landscape";
  close();
}

// A compiler that waits for a file before it does its work.
class SlowCompiler {
 public:
  explicit SlowCompiler(const std::filesystem::path& folder) : go_(folder / "go"), path_(std::getenv("PATH")) {
    const auto program = folder / "g++";
    std::ofstream(program) << "#!/bin/sh\nwhile [ ! -e '" << go_.string() << "' ]; do sleep 0.1; done\nPATH='" << path_
                           << "' exec g++ \"$@\"\n";
    std::filesystem::permissions(program, std::filesystem::perms::owner_all);
    setenv("PATH", (folder.string() + ":" + path_).c_str(), 1);
  }
  ~SlowCompiler() { setenv("PATH", path_.c_str(), 1); }
  void go() { std::ofstream(go_) << "go"; }

 private:
  const std::filesystem::path go_;
  const std::string path_;
};

TEST_F(Window, AWorldThatTheServerHasToCompileIsWaitedForAndEscGivesUp) {
  SlowCompiler compiler(folder_ / "");
  ServerProcess server(RIDGECAST_SERVER, {"--terrain-dir", RIDGECAST_PATHS "/../../../common/terrain/tutorial", "--terrain-cache",
                                          (folder_ / "cache").string()});
  const std::string url = server.url() + "?session=slow&terrain=dunes&param=tallest=550";
  open({"--threshold", "50"}, url);
  ASSERT_TRUE(says("to prepare the terrain")) << viewer_->output();
  ASSERT_TRUE(await([&] { return !windowNumber().empty(); }, 300s));
  press({"Escape"});
  EXPECT_EQ(viewer_->wait(300s), 1) << viewer_->output();
  EXPECT_NE(viewer_->output().find("closed before the server"), std::string::npos) << viewer_->output();

  open({"--threshold", "50"}, url);
  ASSERT_TRUE(says("to prepare the terrain")) << viewer_->output();
  compiler.go();
  ASSERT_TRUE(opened()) << viewer_->output();
  EXPECT_NE(viewer_->output().find("viewing dunes"), std::string::npos) << viewer_->output();
  close();

  // The server dies at it.
  std::filesystem::remove(folder_ / "go");
  open({"--threshold", "50"}, server.url() + "?session=slower&terrain=dunes&param=tallest=551");
  ASSERT_TRUE(says("to prepare the terrain")) << viewer_->output();
  server.process().signal(SIGKILL);
  EXPECT_EQ(viewer_->wait(300s), 1) << viewer_->output();
  EXPECT_NE(viewer_->output().find("went away while it prepared the terrain"), std::string::npos) << viewer_->output();
}

TEST_F(Window, AHeightMapIsCompiledBesideTheWindow) {
  std::ofstream map(folder_ / "hills.r16", std::ios::binary);
  for (int k = 0; k < 200 * 200; ++k) map.put(static_cast<char>(k % 200)).put(static_cast<char>(k / 200 % 40));
  map.close();
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", (folder_ / "hills.r16").string(), "--raster", "size=200x200", "--raster", "pitch=25",
                                          "--raster", "scale=0.05", "--raster", "edge=mirror"});
  open({"--threshold", "20", "--reduced-motion"}, server.url());
  ASSERT_TRUE(opened()) << viewer_->output();
  EXPECT_TRUE(says("the graphics driver compiles hills")) << viewer_->output();
  ASSERT_TRUE(says("drawn with hills's own colours")) << viewer_->output();
  press({"f", "1"});
  const render::Picture mesh = rested();
  press({"2"});
  EXPECT_LT(compare(mesh, rested()).moved, 0.2) << "the ray march has the heights, too";
  close();
}

// A terrain that takes the driver long: the window is there before, and can be closed meanwhile.
TEST_F(Window, WhileTheDriverCompilesTheMeshIsThereAndTheWindowCloses) {
  std::string text = readText(RIDGECAST_PATHS "/../../../common/terrain/tutorial/dunes.glsl");
  std::string more;
  for (int k = 0; k < 30; ++k)
    more += "  p = finer5(p);\n  c += 0.001 * stripes(p.cell, p.at, vec2(0.5, c), " + std::to_string(k) + "u).x;\n";
  const std::string function = "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {\n";
  const auto body = text.find(function) + function.size();
  ASSERT_GT(body, function.size());
  text.insert(body, "  Place p = widestPlace(cell, fraction);\n  float c = 0.3;\n" + more + "  if (c > 0.9) return vec3(c);\n");
  std::ofstream(folder_ / "slow.glsl") << text;
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", (folder_ / "slow.glsl").string(), "--terrain-cache", (folder_ / "cache").string()});
  open({"--threshold", "50"}, server.url(), kUncached);
  ASSERT_TRUE(appeared()) << viewer_->output();
  quit();
  EXPECT_EQ(viewer_->wait(300s), 0) << viewer_->output();
  EXPECT_NE(viewer_->output().find("the graphics driver compiles slow"), std::string::npos) << viewer_->output();
  EXPECT_EQ(viewer_->output().find("own colours"), std::string::npos) << "it was closed too late for this test: " << viewer_->output();
}

TEST_F(Window, ABuiltInTerrainIsThereBeforeTheDriverKnowsIt) {
  ServerProcess server(RIDGECAST_SERVER);
  open({"--threshold", "20"}, server.url(), kUncached);
  ASSERT_TRUE(appeared()) << viewer_->output();
  EXPECT_TRUE(shows([](const render::Picture& picture) { return range(picture) > 10; })) << "no landscape";
  EXPECT_FALSE(drawn()) << "this came too late: " << viewer_->output();
  press({"2"});  // the ray march, once there is one
  EXPECT_TRUE(says("drawn with alpine's own colours")) << viewer_->output();
  EXPECT_GT(range(rested()), 10);
  close();
}

TEST_F(Window, AnOldShadingLanguageIsToldAndTheExitCodeSaysSo) {
  ServerProcess server(RIDGECAST_SERVER);
  open({}, server.url(), {{"MESA_GLSL_VERSION_OVERRIDE", "140"}});
  EXPECT_EQ(viewer_->wait(300s), 3) << viewer_->output();
  EXPECT_NE(viewer_->output().find("ridgecast-client: "), std::string::npos) << viewer_->output();
}

}  // namespace
}  // namespace ridgecast
