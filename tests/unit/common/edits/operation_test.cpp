// What each operation makes of the ground, against laws that do not know how it is computed.
#include "common/edits/operation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "tests/support/crater.h"

namespace ridgecast::edits {
namespace {

using lattice::Step;

using testing_support::m;

// Alpine with edits on it.
struct Ground {
  Ground() : base(terrain::create("alpine", 3).value()), history(base) {}
  void apply(Operation o) {
    auto prepared = history.prepare(std::move(o));
    ASSERT_TRUE(prepared) << prepared.error().message;
    ASSERT_TRUE(history.add(std::move(*prepared)));
  }
  // Steps above the terrain's own height at a post, metres from 0.
  std::int32_t rise(double x, double z) const { return history.layer()->riseAt(m(x) >> kPostBits, m(z) >> kPostBits); }
  std::int32_t height(double x, double z) const { return EditedTerrain(base, history.layer()).heightStep({m(x), m(z)}); }

  std::shared_ptr<const terrain::Terrain> base;
  History history;
};

TEST(Edits, RaisingIsWholeInTheCoreAndNothingAtTheBorder) {
  Ground g;
  g.apply({Raise{{m(100), m(-50)}, m(10), m(4), 512}, 0});
  EXPECT_EQ(g.rise(100, -50), 512);
  EXPECT_EQ(g.rise(104, -50), 512);
  EXPECT_NEAR(g.rise(107, -50), 256, 2);  // halfway between core and border
  EXPECT_EQ(g.rise(110, -50), 0);
  for (double d = 4; d < 10; d += 0.5) EXPECT_GE(g.rise(100 + d, -50), g.rise(100.5 + d, -50));
  EXPECT_EQ(g.rise(93, -50), g.rise(107, -50));
}

TEST(Edits, ACraterHasItsDepthAndARim) {
  Ground g;
  g.apply({Crater{{0, 0}, m(20), m(6)}, 0});
  EXPECT_EQ(g.rise(0, 0), -m(6));
  EXPECT_EQ(g.rise(20, 0), m(1.5));
  EXPECT_EQ(g.rise(30, 0), 0);
  EXPECT_EQ(g.rise(0, -20), m(1.5));
}

TEST(Edits, LevelGroundIsLevelAndItsBanksAreNoSteeper) {
  Ground g;
  const std::int32_t height = g.base->heightStep({m(40), m(40)});
  g.apply({Level{{{m(0), m(0)}, {m(80), m(0)}, {m(80), m(80)}, {m(0), m(80)}}, 0, height, 128}, 0});
  for (double z = 0; z <= 80; z += 4)
    for (double x = 0; x <= 80; x += 4) EXPECT_EQ(g.height(x, z), height) << x << " " << z;
  // On a bank of half a metre a metre, or where the ground is within it anyway.
  for (double d = 0.5; d <= 24; d += 0.5) EXPECT_LE(std::abs(g.height(80 + d, 40) - height), m(d) / 2 + 2) << d;
}

// On ground that is steeper than they are.
TEST(Edits, BanksThatDoNotMeetTheGroundRunOutOverTheirLastEightMetres) {
  Ground g;
  const std::int32_t height = g.base->heightStep({0, 0}) + m(60);
  Road road;
  road.line = {{m(-40), m(100), height}, {m(40), m(100), height}};
  road.surveyed = true;
  road.width = m(8);
  g.apply({Level{{{0, 0}}, m(10), height, 64}, 0});
  g.apply({road, 0});
  const auto check = [&](double border, double x, double z) {
    EXPECT_GT(g.rise(x * (border + 24), z * (border + 24)), m(20)) << "a bank that has not met the ground";
    for (double d = 24; d < 32; d += 0.5) {
      const std::int32_t rise = g.rise(x * (border + d), z * (border + d));
      EXPECT_LE(rise - g.rise(x * (border + d + 0.5), z * (border + d + 0.5)), g.rise(x * (border + 24), z * (border + 24)) / 12) << d;
    }
    EXPECT_EQ(g.rise(x * (border + 32), z * (border + 32)), 0);
  };
  check(10, 0, -1);
  check(10, -1, 0);
  check(104, 0, 1);
}

TEST(Edits, ALevelCircleIsRound) {
  Ground g;
  const std::int32_t height = g.base->heightStep({0, 0}) + m(10);
  g.apply({Level{{{0, 0}}, m(15), height, 256}, 0});
  for (double turn = 0; turn < 6.3; turn += 0.1) {
    const double x = std::floor(14 * std::cos(turn) * 2) / 2, z = std::floor(14 * std::sin(turn) * 2) / 2;
    EXPECT_EQ(g.height(x, z), height);
  }
}

TEST(Edits, SmoothingTakesTheRoughnessAndKeepsALevelPlane) {
  Ground g;
  g.apply({Raise{{m(2), m(2)}, m(1), 0, m(3)}, 0});
  const auto roughness = [&] {
    double sum = 0;
    for (double x = -6; x < 6; x += 0.5) sum += std::pow(g.height(x - 0.5, 2) - 2 * g.height(x, 2) + g.height(x + 0.5, 2), 2);
    return sum;
  };
  const double before = roughness();
  g.apply({Smooth{{m(2), m(2)}, m(10), 8}, 0});
  EXPECT_LT(roughness(), before / 20);

  Ground level;
  level.apply({Level{{{0, 0}}, m(60), level.base->heightStep({0, 0}), 256}, 0});
  const auto hash = level.history.layer()->hash();
  level.apply({Smooth{{0, 0}, m(20), 16}, 0});
  EXPECT_EQ(level.history.layer()->hash(), hash);
}

TEST(Edits, ARoadKeepsItsGradeAndCutsAsDeepAsItFillsHigh) {
  Ground g;
  Road road;
  road.line = {{m(0), m(0), 0}, {m(300), m(120), 0}, {m(500), m(-200), 0}};
  road.width = m(8);
  road.grade = 26;
  const Operation prepared = g.history.prepare({road, 0}).value();
  const Road& surveyed = std::get<Road>(prepared.what);
  ASSERT_TRUE(surveyed.surveyed);
  double cut = 0, fill = 0;
  for (std::size_t k = 1; k < surveyed.line.size(); ++k) {
    const lattice::Vertex &a = surveyed.line[k - 1], &b = surveyed.line[k];
    const double length = std::hypot(static_cast<double>(b.x - a.x), static_cast<double>(b.z - a.z));
    EXPECT_LE(length, m(8) + 2);
    EXPECT_LE(std::abs(b.y - a.y), length * 26 / 256 + 2);
    const double over = b.y - g.base->heightStep({b.x, b.z});
    double& most = over > 0 ? fill : cut;
    most = std::max(most, std::abs(over));
  }
  EXPECT_GT(fill, m(1));
  EXPECT_NEAR(cut, fill, 4);
  g.apply(prepared);
  // Across the road it is level, from edge to edge.
  const lattice::Vertex& station = surveyed.line[5];
  const double x = std::floor(static_cast<double>(station.x) / 128) / 2, z = std::floor(static_cast<double>(station.z) / 128) / 2;
  for (double d = -1; d <= 1; d += 0.5) EXPECT_NEAR(g.height(x - d * 0.37, z + d * 0.93), station.y, m(0.35));
}

// What a brush says of a post near a place is what it says without having been asked about the place, even where two stretches of a line
// are equally near.
TEST(Edits, ABrushKeepsAllThatAPlaceNeeds) {
  std::mt19937_64 random(7);
  for (int n = 0; n < 300; ++n) {
    Road road{{}, true, m(3)};
    for (int k = 0; k < 12; ++k)
      road.line.push_back(
          {m(static_cast<double>(random() % 9 * 8)), m(static_cast<double>(random() % 9 * 8)), static_cast<std::int32_t>(random() % 100)});
    const Operation operation{std::move(road), 0};
    Brush brush(operation);
    for (int k = 0; k < 100; ++k) {
      const lattice::Point place{m(static_cast<double>(random() % 120) - 30), m(static_cast<double>(random() % 120) - 30)};
      const lattice::Point post{place.x + m(static_cast<double>(random() % 9) - 4), place.z + m(static_cast<double>(random() % 9) - 4)};
      const bool reaches = brush.reaches(place, m(6));
      const auto said = brush.at(post, 5000), anew = Brush(operation).at(post, 5000);
      if (anew) {
        ASSERT_TRUE(reaches);
      }
      ASSERT_EQ(said.has_value(), anew.has_value());
      if (said) {
        ASSERT_EQ(said->height, anew->height);
      }
    }
  }
}

TEST(Edits, AStampIsLinearBetweenItsSamples) {
  Ground g;
  g.apply({Stamp{{0, 0}, 3, 3, 4, {0, 0, 0, 0, 1024, 0, 0, 0, 0}}, 0});
  EXPECT_EQ(g.rise(0, 0), 1024);
  EXPECT_EQ(g.rise(1, 0), 512);
  EXPECT_EQ(g.rise(0.5, 0), 768);
  EXPECT_EQ(g.rise(1, 1), 256);
  EXPECT_EQ(g.rise(2, 0), 0);
}

TEST(Edits, MaterialsColourTheGroundAndAreTold) {
  Ground g;
  g.apply({Level{{{0, 0}}, m(10), g.base->heightStep({0, 0}), 256}, 6});
  const EditedTerrain edited(g.base, g.history.layer());
  const Step x[] = {0, m(200)}, z[] = {0, 0};
  const float height[] = {0, 0};
  const std::array<float, 3> up[] = {{0, 1, 0}, {0, 1, 0}};
  std::array<float, 3> out[2], own[2];
  edited.colours()(x, z, height, up, 0, out, 2, 3);
  g.base->colours()(x, z, height, up, 0, own, 2, 3);
  EXPECT_EQ(out[0], colourOf(6));
  EXPECT_EQ(out[1], own[1]);
  std::uint8_t materials[] = {99, 99}, ownMaterial = 99;
  edited.materials(x, z, materials);
  g.base->materials({&x[1], 1}, {&z[1], 1}, {&ownMaterial, 1});
  EXPECT_THAT(materials, testing::ElementsAre(6, ownMaterial));
  EXPECT_EQ(terrain::materialName(6, edited.ownMaterials()), "asphalt");
}

TEST(Edits, WhatIsWrongIsSaid) {
  const auto refusal = [](const Operation& o) {
    const auto checked = check(o);
    return checked ? std::string() : checked.error().message;
  };
  constexpr Step kFar = lattice::kMaxPosition + 1;
  EXPECT_NE(refusal({Crater{{kFar, 0}, m(5), m(1)}, 0}).find("beyond the lattice"), std::string::npos);
  EXPECT_NE(refusal({Crater{{0, 0}, m(1e6), m(1)}, 0}).find("0.5 to 256 m"), std::string::npos);
  EXPECT_NE(refusal({Crater{{0, 0}, m(5), -1}, 0}).find("depth"), std::string::npos);
  EXPECT_NE(refusal({Raise{{0, 0}, m(5), m(6), 1}, 0}).find("core"), std::string::npos);
  EXPECT_NE(refusal({Level{{{0, 0}, {m(3000), 0}, {0, m(1)}}, 0, 0, 256}, 0}).find("spans"), std::string::npos);
  EXPECT_NE(refusal({Level{{{0, 0}, {m(1500), 0}, {0, m(1500)}}, 0, 0, 256}, 0}).find("posts"), std::string::npos);
  EXPECT_NE(refusal({Level{{{0, 0}, {1, 1}}, 0, 0, 256}, 0}).find("3 to"), std::string::npos);
  EXPECT_NE(refusal({Smooth{{0, 0}, m(5), 17}, 0}).find("passes"), std::string::npos);
  EXPECT_NE(refusal({Stamp{{0, 0}, 300, 2, 1, std::vector<std::int32_t>(600)}, 0}).find("samples"), std::string::npos);
  EXPECT_NE(refusal({Road{{{0, 0, 0}, {m(1500), 0, 0}, {0, 0, 0}}, false, m(5), 26, 171}, 0}).find("longer"), std::string::npos);
  EXPECT_NE(refusal({Crater{{0, 0}, m(5), m(1)}, 9}).find("material"), std::string::npos);
  EXPECT_NE(refusal({Undo{0}, 0}).find("from 1"), std::string::npos);
}

TEST(Edits, RootsAreExact) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 100'000; ++k) {
    const auto square = static_cast<std::int64_t>(random() >> (4 + random() % 58)), root = rootOf(square);
    ASSERT_LE(root * root, square);
    ASSERT_GT((root + 1) * (root + 1), square);
  }
}

TEST(Operation, IsKnownAgainByWhatBecameOfIt) {
  const Operation road{Road{{{0, 0, 0}, {51200, 0, 0}}, false, 2048, 26, 171}, 6};
  const Operation crater{Crater{{0, 0}, 1280, 256}, 0};
  const Road& line = std::get<Road>(road.what);
  const auto surveyed = [&](std::int32_t height) {
    return Operation{survey(line, std::vector<std::int32_t>(stationsOf(line).size(), height)), road.material};
  };
  EXPECT_TRUE(isMadeOf(road, road));
  EXPECT_TRUE(isMadeOf(crater, crater));
  EXPECT_TRUE(isMadeOf(road, surveyed(300)));
  EXPECT_TRUE(isMadeOf(road, surveyed(-7)));
  EXPECT_TRUE(isMadeOf(surveyed(300), surveyed(300)));
  EXPECT_FALSE(isMadeOf(surveyed(300), surveyed(-7)));
  EXPECT_FALSE(isMadeOf(surveyed(300), road));
  EXPECT_FALSE(isMadeOf(road, crater));
  const auto differs = [&](const char* what, auto&& change) {
    Operation other = road;
    change(other, std::get<Road>(other.what));
    EXPECT_FALSE(isMadeOf(other, surveyed(300))) << what;
  };
  differs("material", [](Operation& o, Road&) { o.material = 1; });
  differs("width", [](Operation&, Road& r) { ++r.width; });
  differs("grade", [](Operation&, Road& r) { ++r.grade; });
  differs("slope", [](Operation&, Road& r) { ++r.slope; });
  differs("end", [](Operation&, Road& r) { ++r.line.back().z; });
  differs("line", [](Operation&, Road& r) { r.line.insert(r.line.begin() + 1, {25000, 9, 0}); });
}

}  // namespace
}  // namespace ridgecast::edits
