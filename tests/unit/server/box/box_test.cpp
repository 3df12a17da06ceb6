#include "server/box/box_mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <random>
#include <utility>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/terrain/raster.h"
#include "tests/support/mesh_check.h"
#include "tests/support/sanitized.h"

namespace ridgecast::box {
namespace {

using testing::HasSubstr;

std::shared_ptr<const terrain::Terrain> terrainOf(const char* name) { return terrain::create(name, 1).value(); }

Watch patient() { return {{}, std::chrono::steady_clock::now() + std::chrono::hours(24), 86'400}; }

Box boxAt(double x, double z, double width, double depth, double error) {
  const auto steps = [](double m) { return static_cast<lattice::Step>(std::floor(m * 256)); };
  return {{steps(x), steps(z)}, {steps(x + width), steps(z + depth)}, error};
}

Result<BoxMesh> make(const terrain::Terrain& terrain, const Box& box, unsigned threads = 2, std::uint32_t most = 2'000'000) {
  scheduling::Executor executor(threads);
  const auto pool = executor.makePool(threads);
  return meshBox(terrain, box, most, *pool, patient());
}

// The largest vertical distance between mesh and terrain: every triangle's own sample of random points, by plain barycentric arithmetic.
double worstError(const BoxMesh& box, const terrain::Terrain& terrain, std::uint64_t points, double* covered) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> unit(0, 1);
  const double area = static_cast<double>(box.high.x - box.low.x) * static_cast<double>(box.high.z - box.low.z);
  double worst = 0, sum = 0;
  for (const mesh::LeafMesh& leaf : box.leaves)
    for (const mesh::Triangle& t : leaf.triangles) {
      const auto &a = leaf.vertices[t[0]], &b = leaf.vertices[t[1]], &c = leaf.vertices[t[2]];
      const double det = (double(b.z) - a.z) * (double(c.x) - a.x) - (double(b.x) - a.x) * (double(c.z) - a.z);
      sum += det / 2;
      const auto n = 1 + static_cast<std::uint64_t>(det / 2 / area * static_cast<double>(points));
      std::vector<lattice::Step> x, z;
      std::vector<double> plane;
      for (std::uint64_t k = 0; k < n; ++k) {
        double u = unit(random), v = unit(random);
        if (u + v > 1) u = 1 - u, v = 1 - v;
        const double px = std::round(a.x + u * (double(b.x) - a.x) + v * (double(c.x) - a.x)),
                     pz = std::round(a.z + u * (double(b.z) - a.z) + v * (double(c.z) - a.z));
        const double dx = px - a.x, dz = pz - a.z, wb = (dz * (double(c.x) - a.x) - dx * (double(c.z) - a.z)) / det,
                     wc = (dx * (double(b.z) - a.z) - dz * (double(b.x) - a.x)) / det;
        if (wb < 0 || wc < 0 || wb + wc > 1) continue;
        x.push_back(leaf.address.x() + static_cast<lattice::Step>(px));
        z.push_back(leaf.address.z() + static_cast<lattice::Step>(pz));
        plane.push_back((a.y + wb * (double(b.y) - a.y) + wc * (double(c.y) - a.y)) / 256);
      }
      std::vector<float> h(x.size());
      terrain.heights(x, z, h);
      for (std::size_t k = 0; k < h.size(); ++k) worst = std::max(worst, std::abs(h[k] - plane[k]));
    }
  *covered = sum / area;
  return worst;
}

TEST(BoxMesh, KeepsItsErrorOnADenseSampleAndCoversTheBox) {
  struct Case {
    const char* terrain;
    Box box;
  };
  for (const auto& [name, box] : {Case{"alpine", boxAt(100, -300, 200, 150, 0.25)}, Case{"alpine", boxAt(-1500, 700, 1200, 800, 4)},
                                  Case{"canyon", boxAt(1e8, -1e8, 300, 300, 1)}, Case{"archipelago", boxAt(5000, 5000, 600, 700, 1)},
                                  Case{"alpine", boxAt(-3, -3, 1, 2, 0.02)}, Case{"alpine", boxAt(1e12 + 3, 1e12, 47, 1001, 1.5)}}) {
    const auto terrain = terrainOf(name);
    const auto made = make(*terrain, box);
    ASSERT_TRUE(made) << made.error().message;
    EXPECT_LE(made->error, box.error);
    EXPECT_GT(made->samples, made->triangles);
    double covered = 0;
    EXPECT_LE(worstError(*made, *terrain, 1'000'000, &covered), made->error + 0.001) << name << " " << box.error;
    EXPECT_DOUBLE_EQ(covered, 1);
    EXPECT_LE(made->low.x, box.low.x);
    EXPECT_GE(made->high.z, box.high.z);
    EXPECT_GE(static_cast<double>(made->low.x), static_cast<double>(box.low.x) - std::max(1.0, box.error * 64));
    const auto report = testing_support::checkMesh(made->leaves);
    EXPECT_TRUE(report.clean()) << report.text();
    EXPECT_EQ(report.triangles, made->triangles);
  }
}

// A height map without end: hills, ridges and noise, posts `pitch` steps apart.
class Map final : public terrain::Terrain, public terrain::Raster {
 public:
  // Oblong: twice as far apart along z.
  Map(terrain::Pitch pitch, std::uint32_t seed, bool isOblong = false) : seed_(seed) {
    shape_.x = {17, pitch};
    shape_.z = {0, isOblong ? 2 * pitch : pitch};
  }
  std::string_view name() const override { return "map"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return seed_; }
  const terrain::Raster* raster() const override { return this; }
  const terrain::RasterShape& shape() const override { return shape_; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) {
      const auto bx = shape_.x.at(x[k]), bz = shape_.z.at(z[k]);
      std::array<std::int32_t, 16> around;
      for (int n = 0; n < 16; ++n) around[static_cast<std::size_t>(n)] = post(bx.sample - 1 + n % 4, bz.sample - 1 + n / 4);
      out[k] = terrain::cubicHeight(around, bx.steps(), bz.steps(), shape_.x.inverse(), shape_.z.inverse());
    }
  }
  void tile(terrain::TileAddress a, terrain::Tile& out) const override {
    for (std::int32_t n = 0; n < static_cast<std::int32_t>(out.size()); ++n)
      out[static_cast<std::size_t>(n)] =
          post(a.i * terrain::kTileSide + n % terrain::kTileSide, a.j * terrain::kTileSide + n / terrain::kTileSide);
  }
  void samples(std::int64_t x, std::int64_t z, std::int32_t columns, std::int32_t rows, std::int32_t* out) const override {
    most = std::max({most.load(), columns, rows});
    Raster::samples(x, z, columns, rows, out);
  }
  mutable std::atomic<std::int32_t> most = 0;  // samples asked for at a time, along a side

 private:
  std::int32_t post(std::int64_t i, std::int64_t j) const {
    const double metres = shape_.x.metres(), x = static_cast<double>(i) * metres, z = static_cast<double>(j) * shape_.z.metres();
    const auto noise =
        static_cast<double>(lattice::mix(lattice::mix(static_cast<std::uint64_t>(i) + seed_) + static_cast<std::uint64_t>(j)) >> 44) /
        (1 << 20);
    return static_cast<std::int32_t>(
        256 * (60 * std::sin(x / 90) * std::cos(z / 70) + 30 * std::abs(std::sin((x + z) / 130)) + 0.4 * metres * noise));
  }
  terrain::RasterShape shape_{.width = 2, .height = 2};
  std::uint32_t seed_;
};

// With four posts a cell, a tile and its surroundings are wider than what a map gives at a time: it wrote beyond its buffers.
TEST(BoxMesh, AsksAMapForNoMoreThanItGives) {
  const Map map(terrain::pitchOf(256), 1);
  const auto made = make(map, boxAt(0, 0, 900, 900, 60), 2, 1000);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(made->spacing, 4);
  EXPECT_TRUE(made->proven);
  EXPECT_LE(map.most, terrain::kTileSide);
}

// A map with a hill on it that its posts do not know, as edits are.
class Raised final : public terrain::Terrain {
 public:
  std::string_view name() const override { return "raised"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  const terrain::Raster* raster() const override { return &map_; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    map_.heights(x, z, out);
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] += 20 * std::exp(-static_cast<float>(std::hypot(static_cast<double>(x[k]), static_cast<double>(z[k]))) / 5120);
  }

 private:
  Map map_{terrain::pitchOf(512), 1};
};
TEST(BoxMesh, DoesNotProveWhatPostsDoNotKnow) {
  const Raised terrain;
  const auto made = make(terrain, boxAt(-40, -30, 80, 70, 1));
  ASSERT_TRUE(made) << made.error().message;
  double covered = 0;
  EXPECT_LE(worstError(*made, terrain, 200'000, &covered), made->error + 0.001);
  EXPECT_FALSE(made->proven);
}

// Walls of 35 m along x and z, or round ones, on hills.
class Cliffs final : public terrain::Terrain {
 public:
  explicit Cliffs(bool round) : round_(round) {}
  std::string_view name() const override { return "cliffs"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) {
      const double a = static_cast<double>(x[k]) / 256, b = static_cast<double>(z[k]) / 256;
      const bool up = round_ ? std::hypot(a - 1000 * std::floor(a / 1000 + 0.5), b) < 137
                             : (std::llround(std::floor(a / 311)) + std::llround(std::floor(b / 223))) % 2 == 0;
      out[k] = static_cast<float>(8 * std::sin(a / 150) + (up ? 35 : 0));
    }
  }

 private:
  bool round_;
};

// A wall that crosses a side between two samples of it once was a ramp there.
TEST(BoxMesh, FindsAWallAcrossItsSide) {
  const Cliffs terrain(false);
  const auto made = make(terrain, {{324, -10}, {1738, 1485}, 0.075}, 2, 200'000);
  ASSERT_TRUE(made) << made.error().message;
  double covered = 0;
  EXPECT_LE(worstError(*made, terrain, 10 * made->samples, &covered), made->error + 0.001);
}

// BOXES=1000 takes half an hour.
int boxesOr(int usual) {
  const char* const given = std::getenv("BOXES");
  return given ? std::atoi(given) : usual;
}

// Boxes anywhere, of all kinds of terrain, with errors from 5 cm to 50 m: ten times as many points as the mesher looked at find no greater
// error.
TEST(BoxMesh, KeepsItsErrorInRandomBoxes) {
  const int boxes = boxesOr(18);
  std::mt19937_64 random(3);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  int refused = 0, proven = 0;
  double closest = 0;
  for (int k = 0; k < boxes; ++k) {
    const auto seed = static_cast<std::uint32_t>(k);
    std::shared_ptr<const terrain::Terrain> terrain;
    if (k % 6 < 3)
      terrain = terrain::create(std::array{"alpine", "canyon", "archipelago"}.at(static_cast<std::size_t>(k % 3)), seed).value();
    else if (k % 6 == 5)
      terrain = std::make_shared<Cliffs>(k % 12 == 11);
    else
      terrain = std::make_shared<Map>(static_cast<terrain::Pitch>(uniform(200, 8000) * terrain::pitchOf(1)), seed, k % 12 > 6);
    const double error = std::exp(uniform(std::log(0.05), std::log(50))), far = std::exp(uniform(0, std::log(1e9)));
    const Box box = boxAt(uniform(-far, far), uniform(-far, far), error * uniform(20, 200), error * uniform(20, 200), error);
    const auto made = make(*terrain, box, 2, 200'000);
    if (!made) {
      ASSERT_EQ(made.error().kind, Problem::Kind::kTooMuch) << made.error().message;
      refused += k % 6 != 5;  // a mesh cannot follow every wall
      continue;
    }
    double covered = 0;
    const double worst = worstError(*made, *terrain, 10 * made->samples, &covered);
    EXPECT_LE(made->error, error);
    EXPECT_LE(worst, made->error + 0.001) << terrain->name() << ", seed " << k << ", " << error << " m, " << made->triangles
                                          << " triangles";
    EXPECT_DOUBLE_EQ(covered, 1);
    closest = std::max(closest, worst / error);
    proven += made->proven;
    EXPECT_EQ(made->proven, terrain->raster() != nullptr);
  }
  EXPECT_LE(refused, boxes / 20);
  EXPECT_GE(proven, boxes / 4);
  RecordProperty("closest", std::to_string(closest));
}

// Edits of half a metre to fifteen, in boxes whose first samples lie metres apart. SAMPLES=4000000 looks closer, BOXES=1000 at ten of them.
TEST(BoxMesh, KeepsItsErrorOverEdits) {
  const char* const given = std::getenv("SAMPLES");
  const std::uint64_t samples = given ? std::strtoull(given, nullptr, 10) : 400'000;
  std::mt19937_64 random(8);
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution<double>(from, to)(random); };
  const auto steps = [](double metres) { return static_cast<lattice::Step>(metres * lattice::kStepsPerMetre); };
  for (int k = 0; k < std::max(2, boxesOr(0) / 100); ++k) {
    std::shared_ptr<const terrain::Terrain> base = std::make_shared<Map>(1280u, 3u);
    if (k % 2 == 0) base = terrain::create("archipelago", 4).value();
    edits::History history(base);
    for (int n = 0; n < 12; ++n)
      ASSERT_TRUE(history.add({edits::Crater{{steps(uniform(-90, 90)), steps(uniform(-90, 90))},
                                             steps(std::exp(uniform(-0.7, 2.7))),
                                             static_cast<std::int32_t>(steps(uniform(0.3, 4)))},
                               0}));
    const edits::EditedTerrain terrain(base, history.layer());
    const double error = std::exp(uniform(std::log(0.1), std::log(2)));
    const auto made = make(terrain, boxAt(-100, -100, 200, 200, error), 2, 500'000);
    ASSERT_TRUE(made) << made.error().message;
    double covered = 0;
    EXPECT_LE(worstError(*made, terrain, samples, &covered), made->error + 0.001) << base->name() << " " << error;
    EXPECT_DOUBLE_EQ(covered, 1);
  }
}

// A hill as high as the float next to the error, which is greater: the mesh was never done, for the hill neither passed nor got a vertex.
class Hill final : public terrain::Terrain {
 public:
  explicit Hill(float height) : height_(height) {}
  std::string_view name() const override { return "hill"; }
  std::string_view source() const override { return ""; }
  std::uint32_t seed() const override { return 1; }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    for (std::size_t k = 0; k < out.size(); ++k) {
      const double a = static_cast<double>(x[k]) / 12'800, b = static_cast<double>(z[k]) / 12'800;
      out[k] = height_ * static_cast<float>(std::max(0.0, 1 - a * a - b * b));
    }
  }

 private:
  float height_;
};
TEST(BoxMesh, KeepsErrorsThatAreNoFloats) {
  ASSERT_GT(1.85f, 1.85);
  const auto made = make(Hill(1.85f), boxAt(-100, -100, 200, 200, 1.85));
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_LE(made->error, 1.85);
}

TEST(BoxMesh, DependsOnTheQuestionAlone) {
  const auto terrain = terrainOf("alpine");
  const Box box = boxAt(0, 0, 400, 300, 0.5);
  const auto one = make(*terrain, box, 1);
  for (const unsigned threads : {2u, 8u}) {
    const auto other = make(*terrain, box, threads);
    EXPECT_EQ(other->leaves, one->leaves);
    EXPECT_EQ(other->error, one->error);
    EXPECT_EQ(other->samples, one->samples);
  }
}

TEST(BoxMesh, TurnsChangeNothing) {
  const auto terrain = terrainOf("alpine");
  const Box box = boxAt(0, 0, 300, 250, 0.3);
  const auto whole = make(*terrain, box);
  scheduling::Executor executor(2);
  const auto pool = executor.makePool();
  Meshing meshing(*terrain, box, 2'000'000, *pool, patient());
  int turns = 0;
  std::optional<Result<BoxMesh>> made;
  constexpr auto kTurn = std::chrono::microseconds(testing_support::kSanitized ? 2000 : 200);
  for (; !made; ++turns) made = meshing.work(std::chrono::steady_clock::now() + kTurn);
  EXPECT_GT(turns, 10);
  ASSERT_TRUE(*made);
  EXPECT_EQ((*made)->leaves, whole->leaves);
  EXPECT_EQ((*made)->error, whole->error);
  EXPECT_EQ((*made)->samples, whole->samples);
}

// However much there is to do: many thousand points on the sides, millions of samples.
TEST(BoxMesh, LargeBoxesTakeTurnsToo) {
  const auto terrain = terrainOf("alpine");
  for (const auto& [side, most] : {std::pair(9000.0, 20'000u), std::pair(20'000.0, 2'000'000u)}) {
    scheduling::Executor executor(1);
    const auto pool = executor.makePool();
    Meshing meshing(*terrain, boxAt(0, 0, side, side, 0.02), most, *pool, patient());
    std::optional<Result<BoxMesh>> made;
    const auto cpu = [] { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; };
    const double begin = cpu();
    double longest = 0;
    for (double now = begin; !made && now - begin < 4;) {
      made = meshing.work(std::chrono::steady_clock::now() + std::chrono::milliseconds(2));
      longest = std::max(longest, cpu() - std::exchange(now, cpu()));
    }
    EXPECT_LT(longest, testing_support::kSanitized ? 1 : 0.2) << side << " m";
  }
}

TEST(BoxMesh, ASmallerErrorTakesMoreTriangles) {
  const auto terrain = terrainOf("alpine");
  std::uint32_t before = 0;
  for (const double error : {16.0, 4.0, 1.0}) {
    const auto made = make(*terrain, boxAt(0, 0, 300, 300, error));
    EXPECT_GT(made->triangles, 2 * before);
    before = made->triangles;
  }
}

TEST(BoxMesh, WhatIsTooMuchSaysWhatWouldFit) {
  const auto terrain = terrainOf("alpine");
  const Box box = boxAt(0, 0, 2000, 2000, 0.1);
  const auto refused = make(*terrain, box, 2, 20'000);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, Problem::Kind::kTooMuch);
  EXPECT_THAT(refused.error().message, testing::AllOf(HasSubstr("20000 triangles"), HasSubstr("with an error of ")));
  Box fits = box;
  fits.error = std::stod(refused.error().message.substr(refused.error().message.find("with an error of ") + 17));
  EXPECT_GT(fits.error, 0.1);
  EXPECT_TRUE(make(*terrain, fits, 2, 20'000)) << fits.error;
}

TEST(BoxMesh, StopsWhenNobodyWaits) {
  const auto terrain = terrainOf("alpine");
  scheduling::Executor executor(1);
  const auto pool = executor.makePool();
  std::stop_source source;
  source.request_stop();
  Watch watch = patient();
  watch.stop = source.get_token();
  EXPECT_EQ(meshBox(*terrain, boxAt(0, 0, 20'000, 20'000, 1), 2'000'000, *pool, watch).error().kind, Problem::Kind::kStopped);
  watch = {{}, std::chrono::steady_clock::now() + std::chrono::milliseconds(200), 0.2};
  EXPECT_EQ(meshBox(*terrain, boxAt(0, 0, 20'000, 20'000, 1), 2'000'000, *pool, watch).error().kind, Problem::Kind::kTooSlow);
}

}  // namespace
}  // namespace ridgecast::box
