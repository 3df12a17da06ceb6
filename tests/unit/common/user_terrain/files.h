#pragma once
// Terrain files of a folder that goes with the test.

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/process/child.h"
#include "common/process/scratch.h"
#include "common/user_terrain/catalogue.h"

namespace ridgecast::user_terrain {

inline constexpr std::string_view kColour =
    "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) { return abs(normal.zyx) + "
    "dFdx(height); }\n";

class Files : public testing::Test {
 protected:
  void SetUp() override {
    if (!process::findProgram("glslangValidator") || !(process::findProgram("g++") || process::findProgram("c++")))
      GTEST_SKIP() << "needs glslangValidator and g++";
  }
  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::filesystem::path file = folder_.path() / name;
    std::ofstream(file, std::ios::binary) << text;
    return file;
  }
  Request request(const std::filesystem::path& file) const {
    Request r;
    r.terrain = file.string();
    r.build.cache = folder_.path() / "cache";
    r.build.prober = RIDGECAST_SERVER;
    return r;
  }
  // A terrain whose height is these statements.
  Outcome<std::shared_ptr<const terrain::Terrain>> made(const std::string& body, const std::string& before = "") {
    const std::filesystem::path file = write(
        "made" + std::to_string(++count_) + ".glsl",
        before + "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) {\n" + body + "}\n" + std::string(kColour));
    return load(request(file), [this](const std::string& m) { complaints_.push_back(m); });
  }
  // Its height at x, z in steps.
  float at(const std::string& body, const std::string& before = "", lattice::Step x = 256, lattice::Step z = 512) {
    const auto t = made(body, before);
    EXPECT_TRUE(t) << body << ": " << (t ? "" : t.error().message);
    if (!t) return NAN;
    float h = NAN;
    (*t)->heights(std::span(&x, 1), std::span(&z, 1), std::span(&h, 1));
    return h;
  }

  process::Scratch folder_ = process::Scratch::create().value();
  std::vector<std::string> complaints_;
  int count_ = 0;
};

}  // namespace ridgecast::user_terrain
