// Rays over ground of which bounds are known, against a march with steps a sixteenth of the old ones that shares nothing with them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/ground/ground.h"
#include "common/ground/recent.h"
#include "common/process/scratch.h"
#include "common/raster/raster_terrain.h"
#include "common/terrain/variants.h"
#include "tests/support/random_edits.h"

namespace ridgecast::ground {
namespace {

using lattice::Step;
using TerrainPtr = std::shared_ptr<const terrain::Terrain>;

std::size_t raysADay() {
  const char* const given = std::getenv("RAYS");
  return given ? static_cast<std::size_t>(std::atoll(given)) : 1;
}

class Oracle {
 public:
  Oracle(const terrain::Terrain& terrain, const Ray& ray) : terrain_(terrain), ray_(ray) {
    const double length = std::hypot(ray.directionX, ray.directionY, ray.directionZ);
    x_ = ray.directionX / length, y_ = ray.directionY / length, z_ = ray.directionZ / length;
  }
  static double spacing(double t) { return std::max(1.0 / 64, t / 16'384); }
  std::vector<double> above(const std::vector<double>& t) const {
    std::vector<Step> x, z;
    for (const double at : t) {
      x.push_back(ray_.x + std::llround(std::floor(x_ * at * 256 + 0.5)));
      z.push_back(ray_.z + std::llround(std::floor(z_ * at * 256 + 0.5)));
    }
    std::vector<float> height(t.size());
    terrain_.heights(x, z, height);
    std::vector<double> out;
    for (std::size_t k = 0; k < t.size(); ++k) out.push_back(ray_.y + y_ * t[k] - height[k]);
    return out;
  }
  // The first contact from there on, by steps, then halved.
  double contact(double from = 0) const {
    double t = from, before = from;
    for (bool isFirst = true; t < ray_.reach || isFirst;) {
      std::vector<double> at;
      if (isFirst) at.push_back(t);
      while (at.size() < 512 && t < ray_.reach) at.push_back(t = std::min(t + spacing(t), ray_.reach));
      const std::vector<double> g = above(at);
      for (std::size_t k = 0; k < at.size(); ++k) {
        if (g[k] > 0) {
          before = at[k];
          continue;
        }
        double behind = at[k];
        while (behind - before > 1e-4) {
          const double middle = (before + behind) / 2;
          (above({middle})[0] <= 0 ? behind : before) = middle;
        }
        return isFirst && k == 0 ? from : behind;
      }
      isFirst = false;
    }
    return kNoHit;
  }
  // How far the ray stays in the ground from there on, looked at every 2 mm, metres; at most `most`.
  double under(double from, double most) const {
    for (double length = 0; length < most;) {
      std::vector<double> at;
      for (int k = 0; k < 64; ++k) at.push_back(from + length + 0.002 * k);
      for (const double g : above(at)) {
        if (g > 0) return length;
        length += 0.002;
      }
    }
    return most;
  }
  // The most that the ray is above or below the ground between two distances.
  double most(double a, double b) const {
    std::vector<double> at;
    for (int k = 0; k <= 64; ++k) at.push_back(a + (b - a) * k / 64);
    double out = 0;
    for (const double g : above(at)) out = std::max(out, std::abs(g));
    return out;
  }

 private:
  const terrain::Terrain& terrain_;
  const Ray& ray_;
  double x_, y_, z_;
};

struct Judged {
  std::size_t hits = 0, grazed = 0;
};

// Whether a ray ends where the oracle says. Within 1 cm, or on ground that it touches all the way in between (places are 3.9 mm apart, so
// heights along a ray have steps). Contacts shorter than the oracle's spacing may be missed by either.
void judge(const terrain::Terrain& terrain, const Ray& ray, double found, double expected, Judged& judged, const std::string& what) {
  const Oracle oracle(terrain, ray);
  if (expected != kNoHit) ++judged.hits;
  if (found == expected || (found != kNoHit && expected != kNoHit && std::abs(found - expected) <= 0.01)) return;
  ++judged.grazed;
  const bool isLater = expected != kNoHit && (found == kNoHit || found > expected);
  if (found != kNoHit && expected != kNoHit && std::abs(found - expected) < 0.5 && oracle.most(found, expected) < 0.02) return;
  const double spacing = Oracle::spacing(isLater ? expected : found);
  if (isLater) {
    EXPECT_LT(oracle.under(expected, 2 * spacing), spacing) << what << ": missed at " << expected << " m, found " << found;
    return;
  }
  // Earlier than the oracle: there is ground.
  std::vector<double> at;
  for (double t = found - 0.004; t <= found + 0.004; t += 5e-5) at.push_back(t);
  const std::vector<double> near = oracle.above(at);
  EXPECT_LT(*std::ranges::min_element(near), 0.002) << what << ": nothing at " << found << " m, expected " << expected;
}

class Chance {
 public:
  explicit Chance(std::uint64_t seed) : random_(seed) {}
  double operator()(double low, double high) { return low + static_cast<double>(random_() >> 11) * 0x1p-53 * (high - low); }
  // From 5 cm to 200 m up; four of ten graze.
  Ray ray(const terrain::Terrain& terrain, lattice::Point middle, double within, double reach) {
    const auto at = [&](Step v) { return v + static_cast<Step>((*this)(-within, within) * 256); };
    Ray ray{at(middle.x), at(middle.z), 0, (*this)(-1, 1), 0, (*this)(-1, 1), reach};
    const double kind = (*this)(0, 1);
    ray.directionY = kind < 0.4 ? (*this)(-0.03, 0.03) : kind < 0.7 ? (*this)(-0.3, 0.1) : (*this)(-1, 0.1);
    ray.y = terrain.height({ray.x, ray.z}) + ((*this)(0, 1) < 0.5 ? (*this)(0.05, 5) : (*this)(1, 200));
    return ray;
  }

 private:
  std::mt19937_64 random_;
};

void compare(const terrain::Terrain& terrain, const std::vector<Ray>& rays, const std::string& what, std::size_t leastHits) {
  std::vector<double> found(rays.size());
  cast(terrain, rays, found);
  Judged judged;
  for (std::size_t k = 0; k < rays.size(); ++k)
    judge(terrain, rays[k], found[k], Oracle(terrain, rays[k]).contact(), judged, what + ", ray " + std::to_string(k));
  EXPECT_GE(judged.hits, leastHits) << what;
  EXPECT_LE(judged.grazed, rays.size() / 20 + 2) << what;
}

std::vector<Ray> randomRays(const terrain::Terrain& terrain, std::size_t count, double within, double reach, std::uint64_t seed,
                            lattice::Point middle = {}) {
  Chance chance(seed);
  std::vector<Ray> rays;
  for (std::size_t k = 0; k < count; ++k) rays.push_back(chance.ray(terrain, middle, within, reach));
  return rays;
}

TEST(Rays, MeetBuiltInGroundFirstWhereASlowMarchDoes) {
  for (const auto& description : terrain::builtIn())
    for (std::size_t turn = 0; turn < raysADay(); ++turn) {
      const TerrainPtr terrain = terrain::create(description.name, static_cast<std::uint32_t>(7 + turn)).value();
      const std::string name(description.name);
      compare(*terrain, randomRays(*terrain, 3000, 1e5, 60, 1 + turn), name + ", near", 500);
      compare(*terrain, randomRays(*terrain, 3000, 1e9, 60, 2 + turn), name + ", far out", 500);
      compare(*terrain, randomRays(*terrain, 300, 1e6, 3000, 3 + turn), name + ", 3 km", 100);
    }
}

TEST(Rays, StopAtTheFirstSpurOfCanyons) {
  for (std::size_t turn = 0; turn < raysADay(); ++turn) {
    const TerrainPtr canyon = terrain::create("canyon", static_cast<std::uint32_t>(1 + turn)).value();
    std::vector<Ray> rays = randomRays(*canyon, 250, 1e5, 1e4, 4 + turn);
    for (Ray& ray : rays) ray.directionY = 0;
    compare(*canyon, rays, "canyon, level", 50);
  }
}

TEST(Rays, MeetEditedGround) {
  for (const std::string name : {"alpine", "archipelago"}) {
    const TerrainPtr base = terrain::create(name, 3).value();
    edits::History history(base);
    std::mt19937_64 random(5);
    for (std::size_t turn = 0; turn < 3 + raysADay(); ++turn) {
      for (int k = 0; k < 12; ++k)
        if (auto made = history.add(testing_support::randomOperation(random, {}))) EXPECT_TRUE(made);
      // Each time the same ground below another layer: what is known of it stays.
      const edits::EditedTerrain edited(base, history.layer());
      compare(edited, randomRays(edited, 800, 110, 150, 6 + turn), name + ", edited", 200);
      compare(edited, randomRays(edited, 40, 2000, 4000, 7 + turn), name + ", edited, from afar", 5);
    }
  }
}

// A raw file of 16 bits as a terrain; nothing stays on disk.
TerrainPtr mapOf(const std::vector<std::uint16_t>& samples, std::uint32_t width, raster::RasterOptions how) {
  const auto scratch = process::Scratch::create().value();
  {
    std::ofstream out(scratch.path() / "map.r16", std::ios::binary);
    for (const std::uint16_t v : samples) out.put(static_cast<char>(v & 255)).put(static_cast<char>(v >> 8));
  }
  how.width = width, how.height = static_cast<std::uint32_t>(samples.size() / width);
  return raster::loadRaster(scratch.path() / "map.r16", how, 1).value();
}

TEST(Rays, MeetMapsWhateverTheirPitchAndEdge) {
  std::mt19937_64 random(8);
  for (const double pitch : {0.0625, 0.5, 1.0, 10.0, 30.5, 1024.0})
    for (const raster::Edge edge : {raster::Edge::kClamp, raster::Edge::kMirror, raster::Edge::kRepeat, raster::Edge::kConstant}) {
      // Hills with needles and holes one sample wide.
      std::vector<std::uint16_t> samples;
      for (int j = 0; j < 50; ++j)
        for (int i = 0; i < 70; ++i)
          samples.push_back(static_cast<std::uint16_t>(3000 + 1000 * std::sin(i / 7.0) * std::cos(j / 5.0) +
                                                       static_cast<double>(random() % 60) + (random() % 40 == 0 ? 900 : 0) -
                                                       (random() % 40 == 0 ? 900 : 0)));
      raster::RasterOptions how;
      how.pitch = pitch, how.scale = pitch / 1000, how.edge = edge, how.constant = pitch;
      const TerrainPtr map = mapOf(samples, 70, how);
      Chance chance(9);
      std::vector<Ray> rays;
      for (std::size_t k = 0; k < 60 * raysADay(); ++k) {
        Ray ray = chance.ray(*map, {}, 50 * pitch, std::min(150 * pitch, 2e4));
        ray.y = map->height({ray.x, ray.z}) + chance(0.01, 2) * pitch;
        rays.push_back(ray);
      }
      compare(*map, rays, std::to_string(pitch) + " m, edge " + std::to_string(static_cast<int>(edge)), rays.size() / 4);
    }
}

TEST(Rays, StopAtAWallOneSampleWideSixtyKilometresAway) {
  constexpr std::uint32_t kWidth = 6200, kHeight = 32;
  std::vector<std::uint16_t> samples(kWidth * kHeight, 1000);
  for (std::uint32_t j = 0; j < kHeight; ++j) samples[j * kWidth + 6100] = 3000;
  raster::RasterOptions how;
  how.pitch = 10, how.scale = 0.1;
  const TerrainPtr map = mapOf(samples, kWidth, how);
  const terrain::RasterShape& shape = map->raster()->shape();
  Chance chance(10);
  std::vector<Ray> rays;
  for (std::size_t k = 0; k < 1000 * raysADay(); ++k)
    rays.push_back({shape.x.of(100) + static_cast<Step>(chance(-2560, 2560)), static_cast<Step>(chance(-20'000, 20'000)), chance(150, 250),
                    1, chance(-0.0005, 0.0005), chance(-0.001, 0.001), 1e5});
  std::vector<double> found(rays.size());
  cast(*map, rays, found);
  Judged judged;
  for (std::size_t k = 0; k < rays.size(); ++k)
    judge(*map, rays[k], found[k], Oracle(*map, rays[k]).contact(59'900), judged, "wall, ray " + std::to_string(k));
  EXPECT_EQ(judged.hits, rays.size());
}

TEST(Rays, EndAtOnceAboveTheHighestGround) {
  std::vector<Ray> rays;
  for (int k = 0; k < 100; ++k) rays.push_back({k * 1000, 0, 5000, std::sin(k * 0.1), k * 0.001, std::cos(k * 0.1), 1e5});
  std::vector<double> found(rays.size());
  for (const auto& description : terrain::builtIn()) {
    std::uint64_t heights = 0;
    cast(*terrain::create(description.name, 1).value(), rays, found, &heights);
    EXPECT_EQ(heights, 0u);
    EXPECT_EQ(std::ranges::count(found, kNoHit), 100);
  }
}

TEST(Rays, NoGroundLiesBeyondItsTerrainsLowestAndHighest) {
  std::mt19937_64 random(11);
  for (const auto& description : terrain::builtIn()) {
    const TerrainPtr terrain = terrain::create(description.name, 9).value();
    std::vector<Step> x, z;
    for (int k = 0; k < 200'000; ++k) {
      x.push_back(static_cast<Step>(random() >> 13) - (Step{1} << 50));
      z.push_back(static_cast<Step>(random() >> 13) - (Step{1} << 50));
    }
    std::vector<float> height(x.size());
    terrain->heights(x, z, height);
    const auto [low, high] = std::ranges::minmax(height);
    EXPECT_GE(low, terrain->relief().lowest);
    EXPECT_LE(high, terrain->relief().highest);
  }
}

TEST(Rays, EndAtTheLatticesEnd) {
  const TerrainPtr alpine = terrain::create("alpine", 1).value();
  Ray ray{lattice::kMaxPosition - 1000, 5, 0, 1, 0.001, 0, 1e5};
  ray.y = 3200;
  EXPECT_EQ(cast(*alpine, ray), kNoHit);
  ray.y = alpine->height({ray.x, ray.z}) - 1;
  EXPECT_EQ(cast(*alpine, ray), 0) << "it begins below the ground";
  ray.reach = 0;
  EXPECT_EQ(cast(*alpine, ray), 0);
  ray.y += 2;
  EXPECT_EQ(cast(*alpine, ray), kNoHit);
  ray.x = lattice::kMaxPosition + 1;
  EXPECT_EQ(cast(*alpine, ray), kNoHit);
}

// A built-in terrain by one instruction set.
class OfVariant final : public terrain::Terrain {
 public:
  OfVariant(const terrain::Terrain& like, std::size_t index, std::size_t variant) : like_(like), index_(index), variant_(variant) {}
  std::string_view name() const override { return like_.name(); }
  std::string_view source() const override { return like_.source(); }
  std::uint32_t seed() const override { return like_.seed(); }
  terrain::Relief relief() const override { return like_.relief(); }
  void heights(std::span<const Step> x, std::span<const Step> z, std::span<float> out) const override {
    terrain::variants()[variant_].terrain[index_].heights(x.data(), z.data(), out.data(), out.size(), seed(), nullptr);
  }

 private:
  const terrain::Terrain& like_;
  std::size_t index_, variant_;
};

TEST(Rays, HaveEqualBitsWithAnyInstructionsCompanyAndThreads) {
  for (std::size_t index = 0; index < terrain::builtIn().size(); ++index) {
    const auto make = [&] { return terrain::create(terrain::builtIn()[index].name, 1).value(); };
    const TerrainPtr terrain = make();
    const std::vector<Ray> rays = randomRays(*terrain, 2000, 300, 2000, 12);
    std::vector<double> expected(rays.size()), found(rays.size());
    cast(*terrain, rays, expected);
    for (std::size_t v = 0; v < terrain::variants().size(); ++v) {
      const OfVariant variant(*terrain, index, v);
      cast(variant, rays, found);
      EXPECT_EQ(found, expected) << terrain::variants()[v].name;
    }
    const TerrainPtr alone = make();
    for (std::size_t k = rays.size(); k-- > 0;) found[k] = cast(*alone, rays[k]);
    EXPECT_EQ(found, expected) << "one by one, in another order";
    for (const std::size_t count : {2, 8}) {
      const TerrainPtr shared = make();
      std::vector<std::vector<double>> all(count, std::vector<double>(rays.size()));
      std::vector<std::jthread> threads;
      for (auto& out : all) threads.emplace_back([&] { cast(*shared, rays, out); });
      threads.clear();
      for (const auto& out : all) EXPECT_EQ(out, expected) << count << " threads";
    }
  }
}

struct Counted {
  explicit Counted(int v) : value(v) { ++alive(); }
  Counted(const Counted& other) : value(other.value) { ++alive(); }
  ~Counted() { --alive(); }
  static std::atomic<int>& alive() {
    static std::atomic<int> count{0};
    return count;
  }
  int value;
};

TEST(Recent, ManyKeepLittleMoreThanAFew) {
  {
    std::vector<std::unique_ptr<Recent<Counted>>> all;
    for (int n = 0; n < 50; ++n) {
      Recent<Counted>::Reader reader(*all.emplace_back(std::make_unique<Recent<Counted>>(160)));
      for (int k = 0; k < 1000; ++k) EXPECT_EQ(reader.at({k, 0, 1}, [&] { return Counted(k); }).value, k);
    }
    EXPECT_LE(Counted::alive(), 4 * 160 + 2 * 160 + 50 * 2 * 12);
    for (const auto& recent : all) {
      Recent<Counted>::Reader reader(*recent);
      EXPECT_EQ(reader.at({999, 0, 1}, [&]() -> Counted { throw std::logic_error("forgotten"); }).value, 999);
    }
  }
  EXPECT_EQ(Counted::alive(), 0);
}

TEST(Recent, KeepsTheLastUsedAndNoMore) {
  {
    Recent<Counted> recent(100);
    std::atomic<int> made{0};
    const auto at = [&](Recent<Counted>::Reader& reader, int k) {
      return reader.at({k, -k, 2}, [&] { return ++made, Counted(7 * k); }).value;
    };
    {
      Recent<Counted>::Reader reader(recent);
      for (int k = 0; k < 100; ++k) EXPECT_EQ(at(reader, k), 7 * k);
      for (int k = 0; k < 100; ++k) EXPECT_EQ(at(reader, k), 7 * k);
    }
    EXPECT_EQ(made, 100);
    for (int k = 100; k < 2000; ++k) {
      Recent<Counted>::Reader reader(recent);
      EXPECT_EQ(at(reader, k), 7 * k);
      EXPECT_EQ(at(reader, 3), 21) << "used all the time";
    }
    EXPECT_EQ(made, 2000) << "3 was not forgotten";
    EXPECT_LE(Counted::alive(), 201);
    std::vector<std::jthread> threads;
    for (int t = 0; t < 8; ++t)
      threads.emplace_back([&] {
        for (int k = 0; k < 3000; ++k) {
          Recent<Counted>::Reader reader(recent);
          ASSERT_EQ(at(reader, k % 700), 7 * (k % 700));
        }
      });
    threads.clear();
    EXPECT_LE(Counted::alive(), 216);
  }
  EXPECT_EQ(Counted::alive(), 0);
}

}  // namespace
}  // namespace ridgecast::ground
