// Where a window begins, on an X server without a screen.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/process.h"
#include "tests/support/server_process.h"

namespace ridgecast {
namespace {

using namespace testing_support;

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
