#include "client/standing/standing_ground.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "common/terrain/terrain.h"

namespace ridgecast::standing {
namespace {

using namespace std::chrono_literals;
using lattice::Point;
using lattice::Step;
using testing::HasSubstr;
using Tiles = std::map<std::pair<std::int64_t, std::int64_t>, std::shared_ptr<const Tile>>;

constexpr auto kLong = 60s;
constexpr Step kMetre = 256;

std::shared_ptr<const terrain::Terrain> alpine() { return terrain::create("alpine", 4).value(); }

Heights of(std::shared_ptr<const terrain::Terrain> terrain) {
  return [terrain = std::move(terrain)](auto x, auto z, auto out) -> Outcome<void> {
    terrain->heights(x, z, out);
    return {};
  };
}

std::unique_ptr<StandingGround> make(Heights heights, const StandingGround::Options& options = {}) {
  auto made = StandingGround::open(std::move(heights), options);
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
}

// As a program keeps them.
void take(StandingGround& ground, Tiles& held) {
  const Changes changes = ground.changes();
  for (const auto& tile : changes.gone) {
    const auto at = held.find({tile->i, tile->j});
    ASSERT_TRUE(at != held.end() && at->second == tile) << "a tile goes that did not come";
    held.erase(at);
  }
  for (const auto& tile : changes.came) ASSERT_TRUE(held.emplace(std::pair(tile->i, tile->j), tile).second) << "a tile comes twice";
}

void settle(StandingGround& ground, Tiles& held) {
  const auto there = ground.wait(kLong);
  ASSERT_TRUE(there) << there.error().message;
  take(ground, held);
}

bool covers(const Tiles& held, Point body, Step radius, Step spacing) {
  const Step side = kCells * spacing;
  for (const Step x : {body.x - radius, body.x, body.x + radius})
    for (const Step z : {body.z - radius, body.z, body.z + radius}) {
      const auto index = [&](Step at) {
        return static_cast<std::int64_t>(std::floor(static_cast<double>(at) / static_cast<double>(side)));
      };
      if (!held.contains({index(x), index(z)})) return false;
    }
  return true;
}

TEST(StandingGround, HasTheTerrainsBitsAndItsError) {
  const auto terrain = alpine();
  for (const Step spacing : {Step{4}, Step{64}, kMetre, 30 * kMetre}) {
    const auto ground = make(of(terrain), {.spacing = spacing, .radius = 10 * spacing});
    Tiles held;
    const Step far = (Step{1} << 49) + 12345;
    ASSERT_TRUE(ground->move(std::vector<Point>{{500, -700}, {far, -far}}));
    settle(*ground, held);
    ASSERT_FALSE(held.empty());
    std::mt19937_64 random(3);
    for (const auto& [key, tile] : held) {
      ASSERT_EQ(tile->heights.size(), 33u * 33u);
      for (int k = 0; k < 40; ++k) {
        const auto a = static_cast<std::int64_t>(random() % 33), b = static_cast<std::int64_t>(random() % 33);
        const Step x = tile->x() + a * spacing, z = tile->z() + b * spacing;
        float height = 0;
        terrain->heights({&x, 1}, {&z, 1}, {&height, 1});
        ASSERT_EQ(tile->heights[static_cast<std::size_t>(b * 33 + a)], height);
      }
      // Any place, against both ways to split its square.
      for (int k = 0; k < 400; ++k) {
        const Step x = tile->x() + static_cast<Step>(random() % static_cast<std::uint64_t>(kCells * spacing));
        const Step z = tile->z() + static_cast<Step>(random() % static_cast<std::uint64_t>(kCells * spacing));
        float height = 0;
        terrain->heights({&x, 1}, {&z, 1}, {&height, 1});
        const Step a = (x - tile->x()) / spacing, b = (z - tile->z()) / spacing;
        const double u = static_cast<double>((x - tile->x()) % spacing) / static_cast<double>(spacing);
        const double v = static_cast<double>((z - tile->z()) % spacing) / static_cast<double>(spacing);
        const auto at = [&](Step i, Step j) { return static_cast<double>(tile->heights[static_cast<std::size_t>((b + j) * 33 + a + i)]); };
        const double rising =
            u >= v ? at(0, 0) * (1 - u) + at(1, 0) * (u - v) + at(1, 1) * v : at(0, 0) * (1 - v) + at(0, 1) * (v - u) + at(1, 1) * u;
        const double falling = u + v <= 1 ? at(0, 0) * (1 - u - v) + at(1, 0) * u + at(0, 1) * v
                                          : at(1, 1) * (u + v - 1) + at(1, 0) * (1 - v) + at(0, 1) * (1 - u);
        ASSERT_LE(std::abs(height - rising), tile->error * 1.05 + 1e-3);
        ASSERT_LE(std::abs(height - falling), tile->error * 1.05 + 1e-3);
      }
      EXPECT_EQ(tile->lowest, *std::ranges::min_element(tile->heights));
      EXPECT_EQ(tile->highest, *std::ranges::max_element(tile->heights));
    }
  }
}

TEST(StandingGround, GoesWithBodiesThatMove) {
  const auto ground = make(of(alpine()), {.radius = 20 * kMetre});
  Tiles held;
  std::mt19937_64 random(9);
  std::vector<Point> bodies(50), speeds(50);
  for (std::size_t k = 0; k < bodies.size(); ++k) {
    bodies[k] = {static_cast<Step>(random() % 100'000), static_cast<Step>(random() % 100'000)};
    speeds[k] = {static_cast<Step>(random() % 4000) - 2000, static_cast<Step>(random() % 4000) - 2000};
  }
  std::uint64_t version = 0;
  for (int step = 0; step < 100; ++step) {
    for (std::size_t k = 0; k < bodies.size(); ++k) bodies[k] = {bodies[k].x + speeds[k].x, bodies[k].z + speeds[k].z};
    if (step % 25 == 24) bodies[0] = {bodies[0].x + (Step{1} << 40), bodies[0].z};  // put elsewhere
    if (step == 60) bodies.resize(30), speeds.resize(30);
    ASSERT_TRUE(ground->move(bodies));
    settle(*ground, held);
    for (const Point& body : bodies) ASSERT_TRUE(covers(held, body, 20 * kMetre, kMetre));
    for (const auto& [key, tile] : held) version = std::max(version, tile->version);
  }
  EXPECT_LE(held.size(), bodies.size() * 16);
  EXPECT_GE(version, held.size());
  ASSERT_TRUE(ground->move({}));
  settle(*ground, held);
  EXPECT_TRUE(held.empty());
  EXPECT_EQ(ground->bytes(), 0u);
}

TEST(StandingGround, ABodyThatGoesToAndFroKeepsItsTiles) {
  std::atomic<std::size_t> asked{0};
  const auto terrain = alpine();
  const auto ground = make([&](auto x, auto z, auto out) -> Outcome<void> {
    ++asked;
    terrain->heights(x, z, out);
    return {};
  });
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  const std::size_t before = asked;
  for (int step = 0; step < 200; ++step) {
    ASSERT_TRUE(ground->move(std::vector<Point>{{(step % 2 ? 7 : -7) * kMetre, (step % 3 - 1) * 7 * kMetre}}));
    settle(*ground, held);
  }
  EXPECT_EQ(asked, before);
}

TEST(StandingGround, BodiesCloseTogetherShareTiles) {
  const auto ground = make(of(alpine()));
  std::vector<Point> bodies;
  for (int k = 0; k < 1000; ++k) bodies.push_back({k % 10 * kMetre, k / 10 * kMetre / 10});
  Tiles held;
  ASSERT_TRUE(ground->move(bodies));
  settle(*ground, held);
  EXPECT_LE(held.size(), 25u);
}

// The thread is held while the program moves on: nothing waits for it, and what went before it was told is never told.
TEST(StandingGround, MovesDoNotWaitForHeights) {
  std::mutex busy;
  const auto terrain = alpine();
  const auto ground = make([&](auto x, auto z, auto out) -> Outcome<void> {
    const std::lock_guard lock(busy);
    terrain->heights(x, z, out);
    return {};
  });
  Tiles held;
  {
    const std::lock_guard lock(busy);
    for (int step = 0; step < 1000; ++step) {
      ASSERT_TRUE(ground->move(std::vector<Point>{{step * 100 * kMetre, 0}}));
      take(*ground, held);
    }
    EXPECT_TRUE(held.empty());
    const auto there = ground->wait(0ms);
    ASSERT_FALSE(there);
    EXPECT_THAT(there.error().message, HasSubstr("in time"));
  }
  settle(*ground, held);
  EXPECT_TRUE(covers(held, {999 * 100 * kMetre, 0}, 32 * kMetre, kMetre));
}

TEST(StandingGround, WhoNeverAsksForChangesKeepsNothing) {
  const auto ground = make(of(alpine()), {.radius = 0});
  for (int step = 0; step < 300; ++step) {
    ASSERT_TRUE(ground->move(std::vector<Point>{{step * 1000 * kMetre, 0}}));
    ASSERT_TRUE(ground->wait(kLong));
  }
  const Changes changes = ground->changes();
  EXPECT_TRUE(changes.gone.empty());
  EXPECT_LE(changes.came.size(), 4u);
}

TEST(StandingGround, MemoryIsBounded) {
  const auto ground = make(of(alpine()), {.radius = 300 * kMetre, .memory = 100'000});
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  const auto there = ground->wait(kLong);
  ASSERT_FALSE(there);
  EXPECT_THAT(there.error().message, HasSubstr("memory"));
  EXPECT_LE(ground->bytes(), 100'000u);
  Tiles held;
  take(*ground, held);
  EXPECT_TRUE(held.contains({0, 0})) << "the nearest come first";
  ASSERT_TRUE(ground->move(std::vector<Point>{{Step{1} << 40, 0}, {Step{1} << 40, 0}}));
  EXPECT_FALSE(ground->wait(kLong));
  take(*ground, held);
  EXPECT_FALSE(held.contains({0, 0})) << "what is not needed makes room";
}

TEST(StandingGround, HeightsThatFailAreAskedAgain) {
  std::atomic<bool> fails{true};
  const auto terrain = alpine();
  const auto ground = make([&](auto x, auto z, auto out) -> Outcome<void> {
    if (fails) return Error{"the server is away"};
    terrain->heights(x, z, out);
    return {};
  });
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  std::optional<Error> why;
  while (!why || why->message != "the server is away") why = ground->wait(10ms).error();
  fails = false;
  Tiles held;
  settle(*ground, held);
  EXPECT_TRUE(covers(held, {0, 0}, 32 * kMetre, kMetre));
}

TEST(StandingGround, RefusesWhatCannotBe) {
  for (const Step spacing : {Step{0}, Step{-4}, Step{2}, Step{6}, Step{1} << 21})
    EXPECT_FALSE(StandingGround::open(of(alpine()), {.spacing = spacing})) << spacing;
  EXPECT_FALSE(StandingGround::open(of(alpine()), {.radius = -1}));
  EXPECT_FALSE(StandingGround::open(of(alpine()), {.radius = 3000 * kMetre}));
  const auto ground = make(of(alpine()));
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  const auto beyond = ground->move(std::vector<Point>{{0, 0}, {0, lattice::kMaxPosition}});
  ASSERT_FALSE(beyond);
  EXPECT_THAT(beyond.error().message, HasSubstr("body 1 "));
  EXPECT_FALSE(ground->move(std::vector<Point>{{std::numeric_limits<Step>::min(), 0}}));
  EXPECT_FALSE(ground->move(std::vector<Point>(kMostBodies + 1)));
  Tiles held;
  settle(*ground, held);
  EXPECT_TRUE(covers(held, {0, 0}, 32 * kMetre, kMetre)) << "nothing changed";
}

}  // namespace
}  // namespace ridgecast::standing
