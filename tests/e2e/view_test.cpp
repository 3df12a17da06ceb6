// The window on an X server without a screen: it opens, shows a landscape, and closes by itself.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/render/picture.h"
#include "tests/support/process.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

// Standard deviation of the brightness of the part from `left` to `right` (0..1).
double contrast(const render::Picture& p, double left, double right) {
  double sum = 0, squares = 0, n = 0;
  for (std::uint32_t row = 0; row < p.height; ++row)
    for (auto column = static_cast<std::uint32_t>(left * p.width); column < static_cast<std::uint32_t>(right * p.width); ++column) {
      const std::uint8_t* rgb = &p.rgb[3 * (std::size_t{row} * p.width + column)];
      const double v = rgb[0] + rgb[1] + rgb[2];
      sum += v / 3;
      squares += v * v / 9;
      ++n;
    }
  return std::sqrt(squares / n - sum / n * (sum / n));
}

TEST(View, OpensAWindowAndShowsALandscapeTwice) {
  if (!programExists("xvfb-run")) GTEST_SKIP() << "xvfb-run is not installed (package xvfb)";
  ServerProcess server(RIDGECAST_SERVER);
  ScratchFolder folder;
  const std::string picture = (folder / "window.png").string();
  // The mesh to the left of the divider, the ray march to its right: a slow machine may need longer until something is there.
  double left = 0, right = 0;
  for (const char* seconds : {"3", "15", "60"}) {
    const Finished seen = runProgram({"xvfb-run", "-a", "-s", "-screen 0 1024x768x24", RIDGECAST_CLIENT, "view", server.url(), "--size",
                                      "640x360", "--threshold", "4", "--seconds", seconds, "--screenshot", picture},
                                     {{"XDG_CONFIG_HOME", folder / "configuration"}});
    ASSERT_EQ(seen.code, 0) << seen.output;
    const auto window = render::readPng(picture);
    ASSERT_TRUE(window) << window.error().message;
    EXPECT_EQ(window->width, 640u);
    EXPECT_EQ(window->height, 360u);
    left = contrast(*window, 0, 0.5);
    right = contrast(*window, 0.5, 1);
    if (left > 15 && right > 15) break;
  }
  EXPECT_GT(left, 15);
  EXPECT_GT(right, 15);
  EXPECT_TRUE(server.healthy());
}

TEST(View, BeginsOnAMapThatLiesElsewhere) {
  if (!programExists("xvfb-run")) GTEST_SKIP() << "xvfb-run is not installed (package xvfb)";
  ScratchFolder folder;
  std::ofstream(folder / "map.asc") << "ncols 3\nnrows 2\nxllcorner 680000\nyllcorner 5240000\ncellsize 100\n1 2 3\n4 5 6\n";
  ServerProcess server(RIDGECAST_SERVER, {"--terrain", (folder / "map.asc").string(), "--raster", "place=geo"});
  const auto placeAfter = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command{
        "xvfb-run", "-a",        "-s", "-screen 0 640x480x24", RIDGECAST_CLIENT, "view", server.url(), "--size", "160x90", "--threshold",
        "50",       "--seconds", "1"};
    command.insert(command.end(), more.begin(), more.end());
    const Finished seen = runProgram(command, {{"XDG_CONFIG_HOME", folder / "configuration"}});
    EXPECT_EQ(seen.code, 0) << seen.output;
    const auto place = nlohmann::json::parse(std::ifstream(folder / "configuration/ridgecast/window.json")).at("places").at(0);
    return std::pair(std::stod(place.at("x").get<std::string>()), std::stod(place.at("z").get<std::string>()));
  };
  EXPECT_EQ(placeAfter({"--x", "7"}), std::pair(7.0, 0.0));
  EXPECT_EQ(placeAfter({}), std::pair(7.0, 0.0)) << "where one last was";
  std::filesystem::remove_all(folder / "configuration");
  EXPECT_EQ(placeAfter({}), std::pair(680'150.0, -5'240'050.0));
}

}  // namespace
}  // namespace ridgecast
