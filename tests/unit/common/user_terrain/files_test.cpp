// Terrain files from text to heights: the same bits as the built-in terrains, GLSL of many kinds, and what happens when a file turns
// out bad only later.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <random>

#include "common/glsl/library.h"
#include "common/glsl/probe.h"
#include "common/terrain/variants.h"
#include "tests/support/sanitized.h"
#include "tests/unit/common/terrain/points.h"
#include "tests/unit/common/user_terrain/files.h"

namespace ridgecast::user_terrain {
namespace {

using std::filesystem::path;
using testing::HasSubstr;

// fork() calls what pthread_atfork registers; vfork() and posix_spawn() do not. A sanitizer may replace vfork by fork.
std::atomic<int> forks = 0;
TEST_F(Files, WhateverIsCompiledTheProcessIsNeverCopied) {
  if (testing_support::kSanitized) GTEST_SKIP() << "the thread sanitizer's vfork is fork";
  ASSERT_EQ(pthread_atfork([] { ++forks; }, nullptr, nullptr), 0);
  EXPECT_EQ(at("return 2.0;\n"), 2.0f);
  EXPECT_EQ(forks, 0);
}

// Whoever tries a terrain file has room for its variables and no more: the library asks for 256 MiB and says 1 m where it did not get them.
TEST(Probe, LimitsTheMemoryOfItsChild) {
  const auto tried = glsl::probe("greedy.glsl", RIDGECAST_GREEDY_TERRAIN, 8, 1, RIDGECAST_SERVER);
  EXPECT_TRUE(tried) << tried.error().message << ": it was given 256 MiB";
}

// The built-in terrains went through the compiler as they are; through the translation they must come out with the same bits, for every
// instruction set.
TEST_F(Files, translationKeepsEveryBitOfTheBuiltInTerrains) {
  for (const terrain::Description& d : terrain::builtIn()) {
    const path file = write("copy-of-" + std::string(d.name) + ".glsl", std::string(d.source));
    const auto original = terrain::create(d.name, 77).value();
    for (const terrain::Variant& v : terrain::variants()) {
      Request r = request(file);
      r.build.variant = v.name;
      r.seed = 77;
      const auto copy = load(r, nullptr);
      ASSERT_TRUE(copy) << copy.error().message;
      EXPECT_EQ((*copy)->source(), d.source);
      for (const double distance : terrain::kDistances) {
        const terrain::Points p = terrain::pointsAt(distance, 10'000);
        std::vector<float> a(p.x.size()), b(p.x.size());
        original->heights(p.x, p.z, a);
        (*copy)->heights(p.x, p.z, b);
        std::size_t different = 0;
        for (std::size_t i = 0; i < a.size(); ++i) different += std::bit_cast<std::uint32_t>(a[i]) != std::bit_cast<std::uint32_t>(b[i]);
        EXPECT_EQ(different, 0u) << d.name << ", " << v.name << " at " << distance;
      }
    }
  }
}

// Values of a built-in terrain's parameters are read by the code that is there; compiled into a copy of the file they give the same bits.
TEST_F(Files, parametersOfBuiltInTerrainsNeedNoCompiler) {
  for (const terrain::Description& d : terrain::builtIn()) {
    const auto declaration = glsl::readDeclaration(d.name, d.source);
    ASSERT_TRUE(declaration);
    ASSERT_EQ(declaration->parameters.size(), d.parameters) << d.name;
    EXPECT_EQ(glsl::valuesOf(d.source, *declaration).size(), d.parameters);
    Request own = request(d.name), copied = request(write("copy-of-" + std::string(d.name) + ".glsl", std::string(d.source)));
    own.seed = copied.seed = 5;
    for (const glsl::Parameter& p : declaration->parameters) own.parameters.emplace_back(p.name, p.least + 0.37 * (p.most - p.least));
    copied.parameters = own.parameters;
    const auto a = load(own, nullptr);
    EXPECT_EQ(exists(own.build.cache), d.name != terrain::builtIn()[0].name) << "nothing was compiled before the first copy";
    const auto b = load(copied, nullptr);
    ASSERT_TRUE(a && b);
    EXPECT_EQ((*a)->source(), (*b)->source());
    EXPECT_EQ(terrain::contentHash(**a), terrain::contentHash(**b));
    const terrain::Points points = terrain::pointsAt(1e6, 20'000);
    const std::size_t count = points.x.size();
    std::vector<float> usual(count), ha(count), hb(count);
    terrain::create(d.name, 5).value()->heights(points.x, points.z, usual);
    (*a)->heights(points.x, points.z, ha);
    (*b)->heights(points.x, points.z, hb);
    EXPECT_EQ(ha, hb) << d.name;
    EXPECT_EQ(ha == usual, d.name != std::string_view("canyon")) << "the others' parameters are of their colours";
    const std::vector<std::array<float, 3>> up(count, {0, 1, 0});
    std::vector<std::array<float, 3>> ca(count), cb(count), cu(count);
    (*a)->colours()(points.x.data(), points.z.data(), ha.data(), up.data(), 2, ca.data(), count, 5);
    (*b)->colours()(points.x.data(), points.z.data(), ha.data(), up.data(), 2, cb.data(), count, 5);
    terrain::create(d.name, 5).value()->colours()(points.x.data(), points.z.data(), ha.data(), up.data(), 2, cu.data(), count, 5);
    EXPECT_EQ(ca, cb) << d.name;
    EXPECT_NE(ca, cu) << d.name;
  }
  Request wrong = request("alpine");
  wrong.parameters = {{"snowline", 1}};
  EXPECT_THAT(load(wrong, nullptr).error().message, HasSubstr("it has: snowLine, treeLine"));
}

TEST_F(Files, sayWhatTheGroundIsMadeOf) {
  const std::string heights =
      "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return fraction.x * 4096.0; }\n";
  const path file =
      write("made-of.glsl", "//! materials: mud, moor\n" + heights + std::string(kColour) +
                                "const int kMoor = 10;\nint terrainMaterial(ivec2 cell, vec2 fraction, float height, vec3 normal, "
                                "uint seed) {\n  if (normal.y > 0.99) return 0;\n  return height < 8.0 ? 5 : cell.y < 0 ? 9 : kMoor;\n}\n");
  const auto terrain = load(request(file), nullptr);
  ASSERT_TRUE(terrain) << terrain.error().message;
  EXPECT_THAT((*terrain)->ownMaterials(), testing::ElementsAre("mud", "moor"));
  std::vector<lattice::Step> x, z;
  for (int k = 0; k < 1000; ++k) x.push_back(100 + 256 * k), z.push_back(k % 2 == 0 ? -5 : 5);
  std::vector<std::uint8_t> made(x.size());
  (*terrain)->materials(x, z, made);
  for (std::size_t k = 0; k < x.size(); ++k) ASSERT_EQ(made[k], x[k] < 8 * 256 ? 5 : k % 2 == 0 ? 9 : 10) << k;
  const auto silent = load(request(write("silent.glsl", heights + std::string(kColour))), nullptr);
  ASSERT_TRUE(silent);
  (*silent)->materials(x, z, made);
  EXPECT_EQ(made, std::vector<std::uint8_t>(x.size()));
}

TEST_F(Files, parametersReachHeightsTextAndHash) {
  const path file = write("flat.glsl",
                          "const float level = 5.0;  //! 0..50 m: how high\nfloat terrainHeight(ivec2 cell, vec2 fraction, float "
                          "footprint, uint seed) { return level; }\n" +
                              std::string(kColour));
  Request r = request(file);
  const auto plain = load(r, nullptr);
  r.parameters = {{"level", 12.5}};
  const auto raised = load(r, nullptr);
  ASSERT_TRUE(plain && raised);
  EXPECT_EQ((*plain)->name(), "flat");
  EXPECT_EQ((*plain)->height({3, 4}), 5.0);
  EXPECT_EQ((*raised)->height({3, 4}), 12.5);
  EXPECT_THAT(std::string((*raised)->source()), HasSubstr("level = 12.5f;"));
  EXPECT_NE(terrain::contentHash(**plain), terrain::contentHash(**raised));
  r.parameters = {{"level", 51}};
  EXPECT_THAT(load(r, nullptr).error().message, HasSubstr("out of range"));
}

TEST_F(Files, glslOfManyKinds) {
  // x is 1 m, z is 2 m: fraction (1, 2) / 4096.
  EXPECT_EQ(at("return 2. + .5 + 1e1 + float(0x10) + float(7u);\n"), 35.5f);
  EXPECT_EQ(at("vec4 v = vec4(1, 2, 3, 4); return v.wzyx.x * 1000. + v.rgb.b * 100. + v.st.t * 10. + v.a;\n"), 4324.0f);
  EXPECT_EQ(at("vec3 v = vec3(fraction * 4.0, 3.0); return (dot(v.zx, v.xy) + v[1] + v.yyy.z) * 1024.0;\n"),
            3.0f + 2.0f / 1024 + 2.0f + 2.0f);
  EXPECT_EQ(at("mat2 m = mat2(1.0, 2.0, 3.0, 4.0); vec2 v = m * vec2(1.0, 1.0); return v.x * 10.0 + v.y + (vec2(1.0) * m).x * 100.0;\n"),
            346.0f);
  EXPECT_EQ(
      at("float a[3] = float[3](1.0, 2.0, 4.0); float s = 0.0; for (int i = 0; i < 3; i++) s += a[i]; return s + float(a.length());\n"),
      10.0f);
  EXPECT_EQ(at("return table[1] + table[2];\n", "const float table[] = float[](1.0, 2.0, 4.0);\n"), 6.0f);
  EXPECT_EQ(
      at("float a, b; both(3.0, a, b); return a + b;\n", "void both(in float v, out float a, inout float b) { a = v; b = v * 2.0; }\n"),
      9.0f);
  EXPECT_EQ(at("Hill h = Hill(vec2(3.0, 4.0), 2.0); h.r *= 2.0; return h.r + h.xy.y;\n", "struct Hill { vec2 xy; float r; };\n"), 8.0f);
  EXPECT_EQ(at("#define TWICE(x) ((x) * 2.0)\n#if 0\nwrong\n#endif\nreturn TWICE(3.0);\n"), 6.0f);
  EXPECT_EQ(at("highp float new = 3.0; float xor = 1.0; return new - xor;\n"), 2.0f);
  EXPECT_EQ(at("float s = 0.0; int i = 0; while (true) { if (++i > 20) break; s += 1.0; } do { s += 1.0; } while (s < 30.0); return s;\n"),
            30.0f);
  EXPECT_EQ(at("float s = 0.0; for (int i = 0; i < 4; ++i) for (int j = 0; j <= i; ++j) { if (j == 2) continue; s += 1.0; } return s;\n"),
            8.0f);
  EXPECT_EQ(at("switch (cell.x) { case 0: return 5.0; default: return 6.0; }\n"), 5.0f);
  EXPECT_EQ(at("ivec2 c = ivec2(7, -7) / 2; return float(c.x * 100 + 7 % 4 * 10 + c.y);\n"), 327.0f);
  EXPECT_EQ(at("float a = 12.0; a /= 1.0 + 2.0; int b = 17; b %= 4 + 1; return a + float(b);\n"), 6.0f);
  EXPECT_EQ(
      at("vec2 v = mod(vec2(5.5, -1.0), 2.0) + step(1.0, fraction) + clamp(vec2(9.0), vec2(0.0), vec2(1.0, 2.0)); return v.x + v.y;\n"),
      5.5f);
  EXPECT_EQ(at("bvec2 b = lessThan(vec2(1.0, 5.0), vec2(2.0)); return any(b) && !all(b) ? 1.0 : 0.0;\n"), 1.0f);
  EXPECT_NEAR(at("return 1000.0 * (sin(1.0) + cos(2.0) + exp(0.5) + log(3.0) + pow(2.0, 1.5) + atan(1.0, -2.0) + length(vec2(3.0, 4.0)) + "
                 "tanh(0.5));\n"),
              1000.0 * (std::sin(1.0) + std::cos(2.0) + std::exp(0.5) + std::log(3.0) + std::pow(2.0, 1.5) + std::atan2(1.0, -2.0) + 5.0 +
                        std::tanh(0.5)),
              0.05);
}

// Of metres far out, whose sine was beyond 1, and then infinite.
TEST_F(Files, wavesAreTrueAndBoundedFarOut) {
  std::string table;
  std::vector<float> angles;
  for (const double v : {0.0, 1.0, -3.0, 1.5, 100.25, -12'345.5, 1e6, 16'777'216.0, 1e9, -2.5e9, 4.4e10}) {
    angles.push_back(static_cast<float>(v));
    table += (table.empty() ? "" : ", ") + std::to_string(angles.back());
  }
  const std::string before = "const float table[] = float[](" + table + ");\n";
  const auto terrain = made(
      "float v = table[min(int(fraction.x * 4096.0), table.length() - 1)];\n"
      "switch (int(fraction.y * 4096.0)) { case 0: return sin(v); case 1: return cos(v); case 2: return tan(v); }\n"
      "vec2 metres = vec2(cell) * 4096.0 + fraction;\n"
      "return 100.0 * sin(metres.x * 0.01) * cos(metres.y * 3.0) + sin(float(cell.x) * 1e25) + tan(float(cell.y) * 1e4) * 1e-6;\n",
      before);
  ASSERT_TRUE(terrain) << terrain.error().message;
  for (std::size_t k = 0; k < angles.size(); ++k) {
    const lattice::Step x = static_cast<lattice::Step>(k) * 256;
    const double v = angles[k], tan = std::tan(v);
    EXPECT_NEAR((*terrain)->height({x, 0}), std::sin(v), 0.005) << v;
    EXPECT_NEAR((*terrain)->height({x, 256}), std::cos(v), 0.005) << v;
    EXPECT_NEAR((*terrain)->height({x, 512}), tan, 0.005 + 1e-5 * tan * tan) << v;
  }
  std::mt19937_64 random(1);
  for (int k = 0; k < 10'000; ++k) {
    const auto anywhere = [&] { return static_cast<lattice::Step>(random() % (1ull << 51)) - (lattice::Step{1} << 50); };
    EXPECT_LE(std::abs((*terrain)->height({anywhere(), anywhere() | 1024})), 111.1);  // a tangent is 1e7 at most
  }
}

TEST_F(Files, coloursAreTried) {
  const auto coloured = [&](const std::string& body) {
    const path file = write("colour" + std::to_string(++count_) + ".glsl",
                            "float terrainHeight(ivec2 cell, vec2 fraction, float footprint, uint seed) { return 5.0; }\n\n"
                            "vec3 terrainColor(ivec2 cell, vec2 fraction, float height, vec3 normal, float footprint, uint seed) {\n" +
                                body + "}\n");
    const auto t = load(request(file), [this](const std::string& m) { complaints_.push_back(m); });
    return t ? "" : t.error().message;
  };
  EXPECT_THAT(coloured("return vec3(sqrt(fraction.x - 2.0));\n"),
              testing::AllOf(HasSubstr(".glsl:3: the colour at x "), HasSubstr("is not a number")));
  EXPECT_THAT(coloured("return vec3(1.0 / (fraction.x - fraction.x));\n"), HasSubstr("is infinite"));
  EXPECT_THAT(complaints_, testing::IsEmpty());
  EXPECT_EQ(coloured("return vec3(12.0, 0.5, 0.5);\n"), "");
  ASSERT_EQ(complaints_.size(), 1u);
  EXPECT_THAT(complaints_[0], testing::AllOf(HasSubstr(".glsl: the colour at x "), HasSubstr("has 12: red, green and blue are shares")));
  complaints_.clear();
  EXPECT_EQ(coloured("return vec3(0.0, 1.0, fraction.x);\n"), "");
  EXPECT_THAT(complaints_, testing::IsEmpty());
}

TEST_F(Files, metresAreAdvisedAgainst) {
  EXPECT_TRUE(made("vec2 metres = ( vec2(cell) + fraction ) * 4096.0;\nreturn sin(metres.x);\n"));
  ASSERT_EQ(complaints_.size(), 1u);
  EXPECT_THAT(complaints_[0], testing::AllOf(HasSubstr("1.glsl:2: 'cell'"), HasSubstr("widestPlace("), HasSubstr("bricks")));
}

// Nothing that a file can write may trap or leave its memory.
TEST_F(Files, nothingTraps) {
  EXPECT_EQ(at("int zero = cell.x; return float(7 / zero) + float(7 % zero) + float((ivec2(3) / ivec2(zero)).x);\n"), 0.0f);
  EXPECT_EQ(at("uint zero = uint(cell.x); uint q = 7u; q /= zero; return float(q) + float(7u % zero);\n"), 0.0f);
  EXPECT_EQ(
      at("int least = -2147483647 - 1; int one = -1 + cell.x; return float(least / one == least) + float(clamp(least % one, -9, 9));\n"),
      1.0f);
  EXPECT_EQ(
      at("float a[2] = float[2](3.0, 4.0); int far = 1000000000 + cell.x; a[far] = 5.0; a[-far] = 6.0; return a[far] * 10.0 + a[-far];\n"),
      56.0f);
  EXPECT_EQ(at("vec2 v = vec2(1.0, 2.0); int far = 99 + cell.x; v[far] = 7.0; return v[far] + v[-far];\n"), 8.0f);
  EXPECT_EQ(at("int s = 40 + cell.x; int big = int(1e30 * float(1 + cell.x)); return float(1 << (s & 15)) + float(big - big);\n"), 256.0f);
}

TEST_F(Files, allErrorsAreToldAtOnceWithLineCaretAndRewrite) {
  const auto t = made(
      "  float b = 1, c = 2.0;\n"
      "  height = 3.0;\n"
      "\tfloat e = pow(b, 2) + c;\n"
      "  return lost(e);\n");
  ASSERT_FALSE(t);
  const std::string& m = t.error().message;
  const auto inOrder = [&](std::initializer_list<const char*> parts) {
    std::size_t at = 0;
    for (const char* part : parts) {
      at = m.find(part, at);
      if (at == std::string::npos) return false;
      ++at;
    }
    return true;
  };
  EXPECT_TRUE(
      inOrder({"1.glsl:2: '='", "write 1.0\n    float b = 1, c = 2.0;\n              ^\n", "1.glsl:3: 'height'",
               "\n    height = 3.0;\n    ^\n", "1.glsl:4: 'pow'", "write 2.0\n  \tfloat e = pow(b, 2) + c;\n  \t                 ^\n",
               "1.glsl:5: 'lost'", "\n    return lost(e);\n           ^"}))
      << m;
}

TEST_F(Files, otherChecksTellAllErrorsToo) {
  const auto refused = [&](const std::string& before, const std::string& body) {
    const auto t = made(body, before);
    return t ? "" : t.error().message;
  };
  EXPECT_THAT(refused("#pragma x\n#include <y>\n", "return 1.0;\n"), testing::AllOf(HasSubstr(":1: #pragma"), HasSubstr(":2: #include")));
  EXPECT_THAT(refused("float a;\nuint b;\n", "return 1.0;\n"), testing::AllOf(HasSubstr(":1: at its top"), HasSubstr(":2: at its top")));
  EXPECT_THAT(refused("", "bool a = cell.x > 0 ^^ cell.y > 0;\nreturn dFdx(fraction.x);\n"),
              testing::AllOf(HasSubstr(":2: the operator ^^"), HasSubstr(":3: 'dFdx' belongs to pictures")));
  // With what would be right.
  EXPECT_THAT(refused("", "return float(seed * 3);\n"), HasSubstr("write 3u\n"));
  EXPECT_THAT(refused("mat2 m = mat2(1.0, 2.0, 3.0, 4.0);\n", "return 1.0;\n"),
              HasSubstr(":1: at its top level a terrain file has functions, structs and constants only; write: const mat2 m = ..."));
  EXPECT_THAT(refused("float t[2] = float[2](1.0, 2.0);\n", "return 1.0;\n"), HasSubstr("write: const float t[2] = ..."));
  EXPECT_THAT(refused("", "return sin(iTime);\n"), HasSubstr("has no time"));
  EXPECT_THAT(refused("", "vec2 uv = gl_FragCoord.xy / iResolution.xy;\nreturn uv.x;\n"), HasSubstr("has no picture"));
  EXPECT_THAT(refused("", "return texture(iChannel0, fraction).x;\n"), HasSubstr("no textures: write valueNoise("));
  const std::string many = refused("", []() {
    std::string lines;
    for (int k = 0; k < 50; ++k) lines += "x" + std::to_string(k) + " = 1.0;\n";
    return lines;
  }());
  EXPECT_THAT(many, testing::AllOf(HasSubstr(":20: 'x18'"), HasSubstr(" errors more"))) << many;
  EXPECT_THAT(many, testing::Not(HasSubstr("'x21'")));
}

TEST_F(Files, aHashOfASineIsAdvisedAgainst) {
  EXPECT_TRUE(made("return fract( sin(dot(fraction, vec2(12.9898, 78.233))) * 43758.5453);\n"));
  ASSERT_EQ(complaints_.size(), 1u);
  EXPECT_THAT(complaints_[0], testing::AllOf(HasSubstr("1.glsl:2: 'fract'"), HasSubstr("valueNoise("), testing::EndsWith("\n         ^")));
  complaints_.clear();
  EXPECT_TRUE(made("return fract(fraction.x) * sin(fraction.y); // fract(sin(x))\n"));
  EXPECT_THAT(complaints_, testing::IsEmpty());
  // A power of what is negative in places, also where heights do not meet it.
  EXPECT_TRUE(made("return 1.0;\n", "float shine(vec2 v) {\n  return pow( sin(v.x * 9.0), 3.0);\n}\n"));
  ASSERT_EQ(complaints_.size(), 1u);
  EXPECT_THAT(complaints_[0],
              testing::AllOf(HasSubstr(".glsl:2: 'pow'"), HasSubstr("write pow(abs(a), b)"), testing::EndsWith("\n           ^")));
  complaints_.clear();
  EXPECT_TRUE(
      made("Place p = widestPlace(cell, fraction); float n = valueNoise(p.cell, p.at, seed).x;\n"
           "return pow(abs(n), 2.0) + pow(0.5 + 0.5 * n, 2.0) + pow(1.0 - sin(n) * n, 2.0); // pow(-n, 2.0)\n"));
  EXPECT_THAT(complaints_, testing::IsEmpty());
}

TEST_F(Files, aHeightThatIsNoNumberNamesTheExpressionAndTheRewrite) {
  const auto told = [&](const std::string& before, const std::string& body) {
    const auto t = made(body, before);
    return t ? "" : t.error().message;
  };
  // Line 2 of the helper; the root above is of a positive number.
  EXPECT_THAT(told("float bent(vec2 v) {\n  float good = sqrt(v.x + 1.0); return good +\n    pow(v.x - 0.5, 1.5);\n}\n",
                   "return bent(fraction);\n"),
              testing::AllOf(HasSubstr(".glsl:3: 'pow': the height at x "), HasSubstr("is not a number"), HasSubstr("write pow(abs(a), b)"),
                             testing::EndsWith("\n      pow(v.x - 0.5, 1.5);\n      ^")));
  EXPECT_THAT(told("", "vec2 v = fraction - fraction;\nreturn normalize(v).x;\n"), HasSubstr(":3: 'normalize': the height at"));
  EXPECT_THAT(told("", "float b = fraction.x - fraction.x;\nfloat h = 1.0;\nreturn h / b;\n"),
              testing::AllOf(HasSubstr(":4: '/': the height at"), HasSubstr("is infinite; keep the divisor above 0")));
  EXPECT_THAT(told("", "return log(fraction.x - 0.5);\n"), HasSubstr(":2: 'log': the height at"));
  // Neither a function nor a division.
  EXPECT_THAT(told("", "float big = 3e38 * (1.0 + fraction.x) * 9.0;\nreturn big - big;\n"),
              testing::AllOf(HasSubstr(":1: the height at x"), HasSubstr("is not a number")));
}

// A file that is fine wherever it was tried, and bad in one cell: heights go on, the first bad one is reported, once.
TEST_F(Files, whatGoesWrongLaterIsReportedOnceAndNeverStops) {
  struct Case {
    const char* body;
    const char* message;
    float height;
  };
  for (const Case& c : {Case{"if (cell.x == 5 && cell.y == 5) return sqrt(-fraction.x); return 1.0;\n", "is not a number", 0.0f},
                        Case{"if (cell.x == 5 && cell.y == 5) return -1.0 / (fraction.x - fraction.x); return 1.0;\n", "is", 0.0f},
                        Case{"if (cell.x == 5 && cell.y == 5) return 1e9; return 1.0;\n", "is absurd", 131072.0f},
                        Case{"float h = 1.0; while (cell.x == 5 && cell.y == 5) h += 1.0; return h;\n", "10,000 steps", 0.0f}}) {
    complaints_.clear();
    const auto t = made(c.body);
    if (!t) {
      // The probe came by this cell after all: then it must say so.
      EXPECT_THAT(t.error().message, HasSubstr(c.message));
      continue;
    }
    const lattice::Step inside = (5ll << 20) + 12345;
    std::vector<lattice::Step> x(600, 256), z(600, 256);
    for (const std::size_t k : {3u, 300u, 599u}) x[k] = z[k] = inside;
    std::vector<float> h(600, -1);
    for (int round = 0; round < 2; ++round) (*t)->heights(x, z, h);
    for (std::size_t i = 0; i < h.size(); ++i) {
      if (x[i] != inside)
        ASSERT_EQ(h[i], 1.0f) << c.body << i;
      else if (c.height != 0.0f)
        ASSERT_EQ(h[i], c.height) << c.body;
      else
        ASSERT_TRUE(std::isfinite(h[i])) << c.body;
    }
    ASSERT_EQ(complaints_.size(), 1u) << c.body;
    EXPECT_THAT(complaints_[0], HasSubstr(c.message));
    EXPECT_THAT(complaints_[0], HasSubstr("x 20528.22266 m, z 20528.22266 m"));
  }
}

}  // namespace
}  // namespace ridgecast::user_terrain
