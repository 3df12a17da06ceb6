// Redis keeps the laws, as a process that is killed and stopped, filled and replaced.
#include <gmock/gmock.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "server/bus/redis.h"
#include "tests/support/redis_server.h"
#include "tests/support/waiting.h"
#include "tests/unit/server/bus/laws.h"

namespace ridgecast::bus {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::HasSubstr;
using testing_support::RedisServer;
using Kind = Appended::Kind;

bool awaitSoon(const std::function<bool()>& so) {
  for (const auto end = std::chrono::steady_clock::now() + testing_support::kTimeout; !so();) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(200us);
  }
  return true;
}

std::shared_ptr<Bus> connectTo(const Redis::Settings& settings, std::shared_ptr<metrics::Metrics> figures = nullptr) {
  auto bus = Redis::connect(settings, figures ? figures : std::make_shared<metrics::Metrics>());
  if (!bus) throw std::runtime_error(bus.error().message);
  return *bus;
}

class RealRedis final : public EngineUnderTest {
 public:
  std::shared_ptr<Bus> connect() override { return connectTo({redis_->url(), {}, {}}); }
  bool await(const std::function<bool()>& so) override { return awaitSoon(so); }
  void stop() override { redis_->kill(); }
  void start() override { redis_->start(); }
  void prepareLoss() override {
    replica_ = std::make_unique<RedisServer>(
        std::vector<std::string>{"--replicaof", "127.0.0.1 " + std::to_string(redis_->port()), "--repl-diskless-sync-delay", "0"});
    ASSERT_TRUE(awaitSoon([&] { return replica_->command({"INFO", "replication"}).find("master_link_status:up") != std::string::npos; }));
    ASSERT_THAT(redis_->command({"WAIT", "1", "0"}), HasSubstr("1"));  // it has all
    replica_->command({"REPLICAOF", "NO", "ONE"});
  }
  void loseEnd(const std::string&, std::size_t) override {
    redis_->kill();
    replica_->listenAt(redis_->port());
    redis_ = std::move(replica_);
  }
  void fill() override { redis_->command({"CONFIG", "SET", "maxmemory", "1"}); }
  void empty() override { redis_->command({"CONFIG", "SET", "maxmemory", "0"}); }

 private:
  std::unique_ptr<RedisServer> redis_ = std::make_unique<RedisServer>(), replica_;
};

INSTANTIATE_TEST_SUITE_P(Redis, LawsOfTheBus, testing::Values([] { return std::make_unique<RealRedis>(); }));

}  // namespace
}  // namespace ridgecast::bus
