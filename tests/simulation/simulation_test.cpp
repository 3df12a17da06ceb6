// A server in one thread and simulated time: members fly, ask, edit the ground, step the clock, are slow, lose their lines and come back,
// or lie; the server falls or another follows it, its disk fills, its memory runs out, as a number says. After each event the laws hold; in
// the end everybody holds the server's mesh on the ground of the log, and when all have left nothing is left. A failure prints its seed and
// as few events as still fail.
//
// SEEDS=10000: so many seeds, instead of 60 (3 under a sanitizer), from FROM=1 on. SEED=17: this one alone, twice. Seeds from 1000000 on
// have 2 to 4 servers over an engine that fails; members come back to any of them, and every law holds for all as for one.
// SEED=17 EVENTS=FILE: with these events instead of its own. SEED=17 SHORTEN=1: only shortens them.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>

#include "server/logging/logging.h"
#include "tests/simulation/shorten.h"
#include "tests/simulation/world.h"
#include "tests/support/process.h"
#include "tests/support/sanitized.h"

namespace ridgecast::simulation {
namespace {

using namespace std::chrono_literals;

constexpr Duration kLife = 20s;

Events eventsOf(std::uint64_t seed) { return simulation::eventsOf(seed, World::hasLiar(seed), World::serversOf(seed) > 1, kLife); }

std::uint64_t historyOf(std::uint64_t seed, const Events& events) {
  World world(seed);
  world.live(events);
  world.calm();
  world.judgeEnd();
  if (seed % 4 == 0 && World::serversOf(seed) == 1 && world.canUndoAll()) {
    world.calm();
    world.undoAll();
    world.calm();
    world.judgeEnd();
  }
  return world.history();
}

std::uint64_t given(const char* name, std::uint64_t otherwise) {
  const char* const value = std::getenv(name);
  return value ? std::strtoull(value, nullptr, 10) : otherwise;
}

unsigned long long n(std::uint64_t count) { return count; }

// `from`, and `seeds` of them, unless the environment names others.
void judgeSeeds(std::uint64_t from, std::uint64_t seeds) {
  logging::setUp(logging::Format::kText, logging::Level::kError);
  const std::uint64_t one = given("SEED", 0), first = one ? one : given("FROM", from);
  if ((World::serversOf(first) > 1) != (World::serversOf(from) > 1)) GTEST_SKIP() << "The environment names other seeds.";
  seeds = one ? 1 : given("SEEDS", seeds);
  met = {};
  if (one && given("SHORTEN", 0)) FAIL() << shorten(one, eventsOf(one));
  for (std::uint64_t seed = first; seed < first + seeds; ++seed) {
    SCOPED_TRACE("SEED=" + std::to_string(seed));
    std::printf("SEED=%llu\n", n(seed));
    std::fflush(stdout);  // it may be its last words
    if (const char* const file = std::getenv("EVENTS")) {
      const auto events = eventsFrom(testing_support::readText(file));
      ASSERT_TRUE(events) << file << " is no list of events";
      historyOf(seed, *events);
      return;
    }
    const Events events = eventsOf(seed);
    const std::uint64_t history = historyOf(seed, events);
    if (seed % 20 == 0 || one) {
      EXPECT_EQ(historyOf(seed, events), history) << "the second run differs";
    }
    if (!testing::Test::HasFailure()) continue;
    if (given("SHORTEN", 1)) std::printf("%s", shorten(seed, events).c_str());
    return;
  }
  std::printf("%.0f s of session time in %.1f s of processor time\n", std::chrono::duration<double>(met.time).count(),
              static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  std::printf("%llu edits, %llu acknowledged, %llu undone in the end; %llu falls, %llu writes lost, %llu storms\n", n(met.edits),
              n(met.acknowledgements), n(met.undone), n(met.falls), n(met.lostWrites), n(met.storms));
  std::printf("%llu acknowledged over HTTP; memory was missing %llu times; %llu edits were there before; %llu handed over\n", n(met.posted),
              n(met.starved), n(met.old), n(met.handedOver));
  if (World::serversOf(first) > 1)
    std::printf(
        "%llu upgrades, %llu failovers, %llu iterations judged, %llu visits, %llu meshes moved; %llu times a server that was cut off was "
        "behind\n",
        n(met.upgrades), n(met.failovers), n(met.judged), n(met.visits), n(met.movedMeshes), n(met.behind));
  if (seeds >= 20) {
    EXPECT_GE(met.acknowledgements, seeds) << "hardly any edit was made";
  }
}

TEST(Simulation, LawsHoldForEverySeed) { judgeSeeds(1, testing_support::kSanitized ? 3 : 60); }

TEST(Simulation, LawsHoldForEverySeedOfSeveralServers) { judgeSeeds(World::kSeveral + 1, testing_support::kSanitized ? 2 : 12); }

}  // namespace
}  // namespace ridgecast::simulation
