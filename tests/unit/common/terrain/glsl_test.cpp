// The terrain as a graphics driver compiles it. Heights through headless EGL must be, bit for bit, those of the C++ side on a driver
// that does not fuse multiplication and addition (Mesa's llvmpipe).

#include <gtest/gtest.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "common/terrain/terrain.h"
#include "tests/support/gpu_heights.h"
#include "tests/unit/common/terrain/points.h"

namespace ridgecast::terrain {
namespace {

std::string text(std::string_view version, const Terrain& terrain, std::string_view main) {
  std::string s = "#version ";
  s.append(version).append("\n");
  if (version.ends_with("es")) s.append("precision highp float;\nprecision highp int;\n");
  s.append(prelude()).append(terrain.source()).append(shading()).append(main);
  return s;
}

TEST(Glsl, compilesInEveryDialect) {
  if (std::system("glslangValidator --version > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "glslangValidator (package glslang-tools) is not installed";
  const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("ridgecast-glsl-" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const std::filesystem::path file = folder / "terrain.frag", log = folder / "log";
  for (const Description& d : builtIn()) {
    for (const std::string_view version : {"330 core", "450", "300 es"}) {
      std::ofstream(file) << text(version, *create(d.name, 1).value(),
                                  "out vec4 colour;\n"
                                  "void main() {\n"
                                  "  vec3 c = shadeTerrain(ivec2(1, 2), gl_FragCoord.xy * 0.001, 0.1, vec3(0.0, 0.0, 1.0), 1.0, 2.0, 3u);\n"
                                  "  colour = vec4(toDisplay(c + skyColor(vec3(0.0, 1.0, 0.0))), 1.0);\n"
                                  "}\n");
      const int status = std::system(("glslangValidator " + file.string() + " > " + log.string() + " 2>&1").c_str());
      std::ifstream in(log);
      EXPECT_EQ(status, 0) << d.name << " as " << version << ":\n" << std::string(std::istreambuf_iterator<char>(in), {});
    }
  }
  std::filesystem::remove_all(folder);
}

class EveryTerrain : public testing_support::HeadlessGl, public testing::WithParamInterface<std::string_view> {};
INSTANTIATE_TEST_SUITE_P(Glsl, EveryTerrain, testing::Values("alpine", "canyon", "archipelago"),
                         [](const auto& i) { return std::string(i.param); });

TEST_P(EveryTerrain, heightsAreTheBitsOfTheServer) {
  const auto terrain = create(GetParam(), 0x1234567u).value();
  const testing_support::GpuHeights gpu(*terrain);
  std::printf("renderer: %s\n", renderer().c_str());
  for (const double distance : kDistances) {
    const Points p = pointsAt(distance, 100'489);
    const std::vector<float> drawn = gpu.at(p.x, p.z);
    std::vector<float> computed(p.x.size());
    terrain->heights(p.x, p.z, computed);
    std::size_t different = 0;
    float worst = 0;
    for (std::size_t i = 0; i < drawn.size(); ++i) {
      different += std::bit_cast<std::uint32_t>(drawn[i]) != std::bit_cast<std::uint32_t>(computed[i]);
      worst = std::max(worst, std::abs(drawn[i] - computed[i]));
    }
    EXPECT_LT(worst, 0.05f) << distance;
    if (isExact()) {
      EXPECT_EQ(different, 0u) << "at " << distance << " m, worst " << worst << " m";
    }
  }
}

}  // namespace
}  // namespace ridgecast::terrain
