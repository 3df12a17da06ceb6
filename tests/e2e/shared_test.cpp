// A server with an engine beside it, which goes and comes back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <regex>
#include <set>

#include "client/world/world.h"
#include "tests/e2e/operator.h"
#include "tests/support/process.h"
#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace testing_support;
using testing::HasSubstr;

TEST(Shared, AServerSaysWhetherItsEngineIsThere) {
  if (!RedisServer::exists()) GTEST_SKIP() << "redis-server is not installed";
  RedisServer redis;
  ServerProcess server(RIDGECAST_SERVER, {"--shared", redis.url(), "--log-level", "info"});
  EXPECT_EQ(get(server.port(), "/readyz"), "ready\n");
  EXPECT_EQ(scrape(server.port())["ridgecast_bus_connected"], 1);
  EXPECT_THAT(server.process().output(), HasSubstr("shares its worlds by " + redis.url() + " as server 1\n"));
  redis.kill();
  EXPECT_TRUE(await([&] { return get(server.port(), "/readyz") == "ready; the engine of --shared is away\n"; }));
  EXPECT_EQ(scrape(server.port())["ridgecast_bus_connected"], 0);
  EXPECT_TRUE(server.healthy());
  redis.start();
  EXPECT_TRUE(await([&] { return get(server.port(), "/readyz") == "ready\n"; }));
  EXPECT_EQ(scrape(server.port())["ridgecast_bus_reconnects_total"], 1);
  EXPECT_GT(scrape(server.port())["ridgecast_bus_away_seconds_total"], 0);
  EXPECT_EQ(server.stop(), 0);
  EXPECT_THAT(server.process().output(), testing::AllOf(HasSubstr(" is away: "), HasSubstr(" is back after ")));
  ServerProcess second(RIDGECAST_SERVER, {}, 0, {{"RIDGECAST_SHARED", redis.url()}});
  EXPECT_THAT(redis.command({"GET", "ridgecast:servers"}), HasSubstr("2"));
}

// A call to the clock that has no effect says so to whoever waits for it.
TEST(Shared, StepsWithoutTheEngineAreRefused) {
  if (!RedisServer::exists()) GTEST_SKIP() << "redis-server is not installed";
  RedisServer redis;
  ServerProcess server(RIDGECAST_SERVER, {"--shared", redis.url()});
  const auto joined = world::World::join(server.url(), {.camera = false});
  ASSERT_TRUE(joined) << joined.error().message;
  world::World& owner = **joined;
  const auto step = [&] { return owner.step(std::chrono::milliseconds(10), kTimeout); };
  ASSERT_TRUE(step());
  redis.kill();
  ASSERT_TRUE(await([&] { return get(server.port(), "/readyz") != "ready\n"; }));
  for (const auto& refused : {step(), owner.setClock(wire::ClockMode::kRealTime, 1, kTimeout)}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().fault, world::Fault::kRefused);
    EXPECT_THAT(refused.error().message, HasSubstr("cannot be reached"));
  }
  redis.start();
  ASSERT_TRUE(await([&] { return get(server.port(), "/readyz") == "ready\n"; }));
  ASSERT_TRUE(step());
  EXPECT_EQ(owner.clock().said().step, 2u);
}

TEST(Shared, AServerSaysHowFullItsEngineIsAndWhatDashboardAndAlertsAsk) {
  if (!RedisServer::exists()) GTEST_SKIP() << "redis-server is not installed";
  RedisServer redis({"--maxmemory", "64mb"});
  const ServerProcess server(RIDGECAST_SERVER, {"--shared", redis.url()});
  auto now = scrape(server.port());
  const double atFirst = now["ridgecast_bus_memory_bytes"];
  EXPECT_GT(atFirst, 100'000);
  EXPECT_EQ(now["ridgecast_bus_memory_limit_bytes"], 64 << 20);
  EXPECT_EQ(now["ridgecast_bus_away_seconds_total"], 0);
  EXPECT_EQ(now.count("ridgecast_bus_calls_total{call=\"append\",result=\"full\"}"), 1u) << "an alert sees the first";
  std::set<std::string> names;
  for (const auto& [name, value] : now) names.insert(name.substr(0, name.find('{')));
  const std::string asked =
      readText(RIDGECAST_DOCKER "/grafana/dashboards/ridgecast.json") + readText(RIDGECAST_DOCKER "/prometheus/rules.yml");
  const std::regex figure("ridgecast_bus_[a-z_]+");
  int found = 0;
  for (auto at = std::sregex_iterator(asked.begin(), asked.end(), figure); at != std::sregex_iterator(); ++at, ++found)
    EXPECT_TRUE(names.contains(at->str())) << at->str();
  EXPECT_GT(found, 10);
  redis.command({"SET", "ballast", std::string(100'000, 'b')});
  EXPECT_TRUE(await([&] { return scrape(server.port())["ridgecast_bus_memory_bytes"] > atFirst + 100'000; }));
}

TEST(Shared, AServerWithoutItsEngineDoesNotStart) {
  const Finished server = runProgram({RIDGECAST_SERVER, "--port", "0", "--shared", "redis://127.0.0.1:" + std::to_string(freePort())});
  EXPECT_EQ(server.code, 2);
  EXPECT_THAT(server.output, testing::AllOf(HasSubstr("The engine at redis://127.0.0.1:"), HasSubstr("cannot be reached")));
}

}  // namespace
}  // namespace ridgecast
