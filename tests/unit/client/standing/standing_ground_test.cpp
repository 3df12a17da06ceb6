#include "client/standing/standing_ground.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "common/edits/edited_terrain.h"
#include "common/edits/history.h"
#include "common/terrain/terrain.h"
#include "tests/support/crater.h"
#include "tests/support/random_edits.h"
#include "tests/support/sanitized.h"

namespace ridgecast::standing {
namespace {

using namespace std::chrono_literals;
using lattice::Point;
using lattice::Step;
using testing::HasSubstr;
using testing_support::craterAt;
using Tiles = std::map<std::pair<std::int64_t, std::int64_t>, std::shared_ptr<const Tile>>;

constexpr auto kLong = 60s;
constexpr Step kMetre = 256;

std::shared_ptr<const terrain::Terrain> alpine() { return terrain::create("alpine", 4).value(); }

Source of(std::shared_ptr<const terrain::Terrain> terrain) { return sourceOf(query::Ground(std::move(terrain))); }

std::unique_ptr<StandingGround> make(Source source, const StandingGround::Options& options = {}) {
  auto made = StandingGround::open(std::move(source), options);
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
}

// Ground that nobody edits.
using Heights = std::function<Outcome<void>(std::span<const Step> x, std::span<const Step> z, std::span<float> out)>;
std::unique_ptr<StandingGround> make(const Heights& heights) {
  return make(Source{[heights](auto x, auto z, auto out) -> Outcome<std::uint64_t> {
                       if (auto known = heights(x, z, out); !known) return known.error();
                       return 0;
                     },
                     [](std::uint64_t) { return query::News(); }, [](auto) {}});
}

// A session's ground, as a member hears of its edits.
class Site {
 public:
  // Heard at once, or by hearAll(). Does nothing where the operation is refused.
  void edit(const edits::Operation& operation, bool isHeard = true) {
    const std::lock_guard lock(mutex_);
    auto prepared = history_.prepare(operation);
    if (!prepared) return;
    const auto posts = history_.add(std::move(*prepared));
    if (!posts) return;
    changes_.push_back({history_.last(), edits::groundOf(*posts)});
    terrain_ = std::make_shared<edits::EditedTerrain>(history_.terrain(), history_.layer());
    if (isHeard) heard_ = history_.last();
  }
  void hearAll() {
    const std::lock_guard lock(mutex_);
    heard_ = history_.last();
  }
  // The server does not know these edits, though it has told of them.
  void forget(std::uint64_t count) {
    const std::lock_guard lock(mutex_);
    forgotten_ = count;
  }
  std::shared_ptr<const terrain::Terrain> terrain() const {
    const std::lock_guard lock(mutex_);
    return terrain_;
  }
  Source source() {
    return {[this](auto x, auto z, auto out) -> Outcome<std::uint64_t> {
              std::unique_lock lock(mutex_);
              const auto terrain = terrain_;
              const std::uint64_t edit = history_.last() - forgotten_;
              lock.unlock();
              terrain->heights(x, z, out);
              if (meanwhile) meanwhile();
              return edit;
            },
            [this](std::uint64_t edit) {
              const std::lock_guard lock(mutex_);
              query::News news{heard_, history_.last(), {}};
              for (const query::Change& change : changes_)
                if (change.edit > edit && change.edit <= heard_) news.changes.push_back(change);
              return news;
            },
            [this](auto) {
              if (awaited) awaited();
            }};
  }
  std::function<void()> meanwhile, awaited;  // called after heights are computed, and while edits are waited for

 private:
  mutable std::mutex mutex_;
  edits::History history_{alpine()};
  std::shared_ptr<const terrain::Terrain> terrain_ = alpine();
  std::vector<query::Change> changes_;
  std::uint64_t heard_ = 0, forgotten_ = 0;
};

void expectTrue(const Tiles& held, const Site& site) {
  const auto terrain = site.terrain();
  for (const auto& [key, tile] : held) {
    std::vector<Step> x, z;
    for (Step b = 0; b <= kCells; ++b)
      for (Step a = 0; a <= kCells; ++a) {
        x.push_back(tile->x() + a * tile->spacing);
        z.push_back(tile->z() + b * tile->spacing);
      }
    std::vector<float> heights(x.size());
    terrain->heights(x, z, heights);
    ASSERT_EQ(tile->heights, heights) << key.first << " " << key.second;
  }
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
  for (int step = 0; step < (testing_support::kSanitized ? 30 : 100); ++step) {
    for (std::size_t k = 0; k < bodies.size(); ++k) bodies[k] = {bodies[k].x + speeds[k].x, bodies[k].z + speeds[k].z};
    if (step % 25 == 24) bodies[0] = {bodies[0].x + (Step{1} << 40), bodies[0].z};  // put elsewhere
    if (step == 27) bodies.resize(30), speeds.resize(30);
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
  for (int step = 0; step < testing_support::rounds(200); ++step) {
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
  for (int step = 0; step < testing_support::rounds(300); ++step) {
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

TEST(StandingGround, TilesThatAnEditTouchesGoAndComeInTheNextChanges) {
  Site site;
  const auto ground = make(site.source());
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  const Tiles before = held;
  site.edit(craterAt(7, 7, 5, 6));
  const auto there = ground->wait(kLong);
  ASSERT_TRUE(there) << there.error().message;
  const Changes changes = ground->changes();
  ASSERT_EQ(changes.gone.size(), 4u) << "the crater and its rim reach over the corner of four";
  ASSERT_EQ(changes.came.size(), 4u);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto& came = changes.came[k];
    EXPECT_TRUE(std::ranges::any_of(changes.gone, [&](const auto& gone) { return gone->i == came->i && gone->j == came->j; }));
    EXPECT_EQ(came->edit, 1u);
    EXPECT_EQ(changes.gone[k]->edit, 0u);
    held[{came->i, came->j}] = came;
  }
  EXPECT_EQ(held.size(), before.size());
  EXPECT_GT(before.at({0, 0})->heights[7 * 33 + 7] - held.at({0, 0})->heights[7 * 33 + 7], 5.9);
  expectTrue(held, site);
  EXPECT_TRUE(ground->changes().came.empty());
}

// They hold bodies up meanwhile.
TEST(StandingGround, TilesStayUntilTheirSuccessorsAreThere) {
  Site site;
  std::mutex busy;
  site.meanwhile = [&] { const std::lock_guard lock(busy); };
  const auto ground = make(site.source());
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  {
    const std::lock_guard lock(busy);
    site.edit(craterAt(16, 16, 5, 6));
    ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
    const Changes changes = ground->changes();
    EXPECT_TRUE(changes.gone.empty() && changes.came.empty());
    EXPECT_FALSE(ground->wait(0ms));
  }
  settle(*ground, held);
  expectTrue(held, site);
}

TEST(StandingGround, SaysWhichBodiesHaveTheirGround) {
  Site site;
  std::mutex busy;
  site.meanwhile = [&] { const std::lock_guard lock(busy); };
  const auto ground = make(site.source());
  const auto ready = [&] {
    std::vector<std::uint8_t> out(ground->bodies());
    ground->ready(out);
    return out;
  };
  const std::vector<Point> bodies{{0, 0}, {5000 * kMetre, 0}};
  EXPECT_THAT(ready(), testing::IsEmpty());
  {
    const std::lock_guard lock(busy);
    ASSERT_TRUE(ground->move(bodies));
    EXPECT_THAT(ready(), testing::ElementsAre(0, 0));
  }
  ASSERT_TRUE(ground->wait(kLong));
  EXPECT_THAT(ready(), testing::ElementsAre(1, 1));
  {
    const std::lock_guard lock(busy);
    site.edit(craterAt(5016, 16, 5, 6));
    ASSERT_TRUE(ground->move(bodies));
    EXPECT_THAT(ready(), testing::ElementsAre(1, 0)) << "an edit is not in the ground there";
  }
  ASSERT_TRUE(ground->wait(kLong));
  EXPECT_THAT(ready(), testing::ElementsAre(1, 1));
  {
    const std::lock_guard lock(busy);
    ASSERT_TRUE(ground->move(std::vector<Point>{{8 * kMetre, 0}, {6000 * kMetre, 0}, {8 * kMetre, 9 * kMetre}}));
    EXPECT_THAT(ready(), testing::ElementsAre(1, 0, 1)) << "what was made ahead serves";
  }
}

TEST(StandingGround, WaitWaitsForTheLastEditKnown) {
  Site site;
  const auto ground = make(site.source());
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  site.edit(craterAt(10, 10, 5, 6), false);
  const auto early = ground->wait(0ms);
  ASSERT_FALSE(early);
  EXPECT_THAT(early.error().message, HasSubstr("edit 1 "));
  site.awaited = [&] { site.hearAll(); };
  settle(*ground, held);
  EXPECT_EQ(held.at({0, 0})->edit, 1u);
  expectTrue(held, site);
}

TEST(StandingGround, AnEditWhileATileIsMadeIsNotMissed) {
  Site site;
  std::atomic<int> made{0};
  site.meanwhile = [&] {
    if (const int k = ++made; k <= 3) site.edit(craterAt(4 * k, 4 * k, 5, 6));
  };
  const auto ground = make(site.source());
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{100, 100}}));
  settle(*ground, held);
  expectTrue(held, site);
  EXPECT_EQ(held.at({0, 0})->edit, 3u);
}

TEST(StandingGround, WhereverBodiesAndEditsGoTilesAreTrue) {
  Site site;
  const auto ground = make(site.source(), {.radius = 20 * kMetre});
  Tiles held;
  std::mt19937_64 random(7);
  std::vector<Point> bodies(8);
  for (int step = 0; step < 150; ++step) {
    for (Point& body : bodies)
      body = {body.x + static_cast<Step>(random() % 8000) - 4000, body.z + static_cast<Step>(random() % 8000) - 4000};
    if (step % 3 == 0) site.edit(testing_support::randomOperation(random, bodies[random() % bodies.size()]));
    if (step % 40 == 39) site.edit({edits::Undo{static_cast<std::uint64_t>(step) / 4}, 0});
    ASSERT_TRUE(ground->move(bodies));
    take(*ground, held);
    if (step % 5 != 4) continue;
    settle(*ground, held);
    for (const Point& body : bodies) ASSERT_TRUE(covers(held, body, 20 * kMetre, kMetre));
    expectTrue(held, site);
  }
}

TEST(StandingGround, WhoMissedManyEditsMakesAllTilesAgain) {
  Site site;
  bool missed = false;
  Source source = site.source();
  const auto since = source.since;
  source.since = [&](std::uint64_t edit) {
    query::News news = since(edit);
    if (missed)
      news.changes = {
          {news.heard, {-2 * lattice::kMaxPosition, -2 * lattice::kMaxPosition, 2 * lattice::kMaxPosition, 2 * lattice::kMaxPosition}}};
    return news;
  };
  const auto ground = make(std::move(source));
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  site.edit(craterAt(10, 10, 5, 6));
  missed = true;
  settle(*ground, held);
  for (const auto& [key, tile] : held) EXPECT_EQ(tile->edit, 1u);
  expectTrue(held, site);
}

TEST(StandingGround, WhatARecordingUndoesByGoingBackIsMadeAgain) {
  Site before, after;
  std::atomic<Site*> now = &before;
  const auto ground = make({[&](auto x, auto z, auto out) { return now.load()->source().heights(x, z, out); },
                            [&](std::uint64_t edit) { return now.load()->source().since(edit); }, [](auto) {}});
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  before.edit(craterAt(10, 10, 5, 6));
  settle(*ground, held);
  expectTrue(held, before);
  now = &after;
  settle(*ground, held);
  expectTrue(held, after);
  // While a tile is made.
  now = &before;
  before.meanwhile = [&] {
    now = &after;
    take(*ground, held);
  };
  before.edit(craterAt(20, 10, 5, 6));
  settle(*ground, held);
  expectTrue(held, after);
}

TEST(StandingGround, EditsAreMadeWhereMemoryIsFull) {
  Site site;
  const auto ground = make(site.source(), {.radius = 300 * kMetre, .memory = 100'000});
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{16 * kMetre, 16 * kMetre}}));
  EXPECT_FALSE(ground->wait(kLong));
  take(*ground, held);
  site.edit(craterAt(16, 16, 5, 6));
  const auto there = ground->wait(kLong);
  ASSERT_FALSE(there);
  EXPECT_THAT(there.error().message, HasSubstr("memory"));
  take(*ground, held);
  EXPECT_EQ(held.at({0, 0})->edit, 1u);
  expectTrue(held, site);
  EXPECT_LE(ground->bytes(), 100'000u);
}

TEST(StandingGround, AServerThatForgetsEditsIsAskedAgain) {
  Site site;
  const auto ground = make(site.source());
  Tiles held;
  ASSERT_TRUE(ground->move(std::vector<Point>{{0, 0}}));
  settle(*ground, held);
  site.forget(1);
  site.edit(craterAt(10, 10, 5, 6));
  std::optional<Error> why;
  while (!why || why->message.find("does not know an edit") == std::string::npos) why = ground->wait(10ms).error();
  site.forget(0);
  settle(*ground, held);
  EXPECT_EQ(held.at({0, 0})->edit, 1u);
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
  EXPECT_FALSE(ground->move(std::vector<Point>(kMaxBodies + 1)));
  Tiles held;
  settle(*ground, held);
  EXPECT_TRUE(covers(held, {0, 0}, 32 * kMetre, kMetre)) << "nothing changed";
}

}  // namespace
}  // namespace ridgecast::standing
