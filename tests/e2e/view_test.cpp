// The window on an X server without a screen: it opens, shows a landscape, and closes by itself.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>

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

}  // namespace
}  // namespace ridgecast
