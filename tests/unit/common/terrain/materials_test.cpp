// What built-in terrains are made of: the same by every variant, and what their colours show.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "common/terrain/materials.h"
#include "common/terrain/terrain.h"
#include "common/terrain/variants.h"

namespace ridgecast::terrain {
namespace {

using lattice::Step;

struct Places {
  explicit Places(const Terrain& terrain) {
    std::mt19937_64 random(7);
    for (int k = 0; k < 20'000; ++k) {
      // Within 16 km, and far out.
      const int bits = k % 4 == 0 ? 49 : 22;
      const auto one = [&] { return static_cast<Step>(random() >> (63 - bits)) - (Step{1} << bits); };
      x.push_back(one());
      z.push_back(one());
    }
    height.resize(x.size());
    normal.resize(3 * x.size());
    material.resize(x.size());
    terrain.heights(x, z, height);
    normals(terrain, x, z, 0, normal);
    terrain.materials(x, z, material);
  }
  std::vector<Step> x, z;
  std::vector<float> height, normal;
  std::vector<std::uint8_t> material;
};

TEST(Materials, HaveNames) {
  const std::vector<std::string> own{"mud"};
  EXPECT_EQ(materialName(0, own), "");
  EXPECT_EQ(materialName(5, own), "grass");
  EXPECT_EQ(materialName(8, own), "snow");
  EXPECT_EQ(materialName(9, own), "mud");
  EXPECT_EQ(materialName(10, own), "");
  EXPECT_TRUE(isMaterialName("built-up_2") && isMaterialName(std::string(32, 'a')));
  EXPECT_FALSE(isMaterialName("") || isMaterialName("Mud") || isMaterialName("a b") || isMaterialName(std::string(33, 'a')));
}

TEST(Materials, EveryVariantSaysTheSame) {
  for (std::size_t k = 0; k < kBuiltIns; ++k) {
    const auto terrain = create(builtIn()[k].name, 3).value();
    const Places p(*terrain);
    for (const Variant& variant : variants()) {
      std::vector<std::uint8_t> out(p.x.size());
      variant.terrain[k].materials(p.x.data(), p.z.data(), p.height.data(), p.normal.data(), out.data(), out.size(), 3, nullptr);
      EXPECT_EQ(out, p.material) << variant.name;
    }
  }
}

TEST(Materials, AreWhatTheColoursShow) {
  const std::map<std::string, std::vector<std::string>> made{{"alpine", {"water", "snow", "gravel", "wood", "grass", "rock"}},
                                                             {"canyon", {"water", "sand", "scrub", "gravel", "rock"}},
                                                             {"archipelago", {"water", "rock", "heath", "wood", "grass", "sand"}}};
  for (const Description& d : builtIn()) {
    SCOPED_TRACE(d.name);
    const auto terrain = create(d.name, 3).value();
    const Places p(*terrain);
    struct Seen {
      double count = 0, red = 0, green = 0, blue = 0;
      double light() const { return (red + green + blue) / count; }
    };
    std::map<std::string, Seen> seen;
    for (std::size_t k = 0; k < p.x.size(); ++k) {
      const std::array<float, 3> normal{p.normal[3 * k], p.normal[3 * k + 1], p.normal[3 * k + 2]};
      std::array<float, 3> c{};
      terrain->colours()(&p.x[k], &p.z[k], &p.height[k], &normal, 0.01f, &c, 1, 3);
      const std::string name(materialName(p.material[k], terrain->ownMaterials()));
      Seen& s = seen[name];
      ++s.count, s.red += c[0], s.green += c[1], s.blue += c[2];
      if (d.name == "alpine") ASSERT_EQ(name == "water", (c == std::array{0.02f, 0.055f, 0.075f}));
      if (d.name == "canyon") ASSERT_EQ(name == "water", (c == std::array{0.055f, 0.068f, 0.042f}));
      if (d.name == "archipelago") ASSERT_EQ(name == "water", p.height[k] <= 0.005f);
    }
    std::vector<std::string> names;
    for (const auto& [name, s] : seen) {
      names.push_back(name);
      if (name == "wood" || name == "grass") EXPECT_TRUE(s.green > s.blue) << name;
      if (name == "snow") EXPECT_TRUE(s.blue > s.red) << name;
    }
    EXPECT_THAT(names, testing::UnorderedElementsAreArray(made.at(std::string(d.name))));
    if (d.name == "alpine") EXPECT_GT(seen["snow"].light(), 1.5 * seen["gravel"].light());
    if (d.name == "alpine") EXPECT_GT(seen["gravel"].light(), seen["rock"].light());
    if (d.name != "canyon") EXPECT_GT(seen["grass"].light(), 1.5 * seen["wood"].light());
    if (d.name == "canyon") EXPECT_GT(seen["sand"].light(), seen["rock"].light());
    if (d.name == "canyon") EXPECT_GT(seen["rock"].red / seen["rock"].green, 1.2 * seen["scrub"].red / seen["scrub"].green);
    if (d.name == "archipelago") EXPECT_GT(seen["sand"].light(), 1.5 * seen["rock"].light());
  }
}

}  // namespace
}  // namespace ridgecast::terrain
