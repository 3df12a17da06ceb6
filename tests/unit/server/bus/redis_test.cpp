// Redis keeps the laws, as a process that is killed and stopped, filled and replaced.
#include <gmock/gmock.h>

#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "server/bus/redis.h"
#include "tests/support/authority.h"
#include "tests/support/redis_server.h"
#include "tests/support/server_process.h"
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

std::shared_ptr<Bus> connectTo(const Redis::Settings& settings, const std::shared_ptr<metrics::Metrics>& figures = nullptr) {
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

// What connect() refuses with; empty: it did not.
std::string refusal(const Redis::Settings& settings) {
  const auto bus = Redis::connect(settings, std::make_shared<metrics::Metrics>());
  return bus ? "" : bus.error().message;
}

class RedisBus : public testing::Test {
 protected:
  Appended append(Bus& bus, std::uint64_t after, std::vector<std::string> entries, Bus::Origin origin = Bus::Origin::kNew) {
    const Answer<Appended> answer;
    bus.append("log", after, std::move(entries), origin, answer.take());
    EXPECT_TRUE(awaitSoon([&] { return answer.has(); }));
    return answer.get();
  }
  Outcome<Bus::Held> hold(Bus& bus, const std::string& key, std::string value, std::uint64_t epoch) {
    const Answer<Outcome<Bus::Held>> answer;
    bus.hold(key, std::move(value), epoch, 1h, answer.take());
    EXPECT_TRUE(awaitSoon([&] { return answer.has(); }));
    return answer.get();
  }
  std::vector<std::string> all(Bus& bus) {
    const Answer<Outcome<std::vector<Entry>>> answer;
    bus.read("log", 0, 1 << 30, answer.take());
    EXPECT_TRUE(awaitSoon([&] { return answer.has(); }));
    std::vector<std::string> out;
    if (const auto page = answer.get())
      for (const Entry& entry : *page) out.push_back(entry.bytes);
    else
      ADD_FAILURE() << page.error().message;
    return out;
  }
  // All of what a server does.
  void useAll(const Redis::Settings& settings) {
    const auto a = connectTo(settings), b = connectTo(settings);
    const Heard<std::uint64_t> changed;
    const Heard<std::string> heard;
    const auto watching = b->watch("log", changed.take());
    const auto hearing = b->hear("channel", heard.take());
    ASSERT_TRUE(awaitSoon([&] { return changed.size() > 0; }));
    EXPECT_EQ(append(*a, 0, {"one"}).kind, Kind::kDone);
    EXPECT_THAT(all(*b), ElementsAre("one"));
    a->tell("channel", "message");
    EXPECT_TRUE(awaitSoon([&] { return changed.last() == 1u && heard.size() == 1; }));
    ASSERT_TRUE(hold(*a, "key", "value", 0));
    ASSERT_TRUE(hold(*a, "key", "value", 1));
    const Answer<Outcome<std::map<std::string, Record>>> listed, empty;
    a->list("k", listed.take());
    a->drop("key", 1);
    a->list("", empty.take());
    ASSERT_TRUE(awaitSoon([&] { return empty.has(); }));
    EXPECT_EQ(listed.get()->size(), 1u);
    EXPECT_EQ(empty.get()->size(), 0u);
  }
};

TEST_F(RedisBus, ServesAUserOfOurSettingsFile) {
  RedisServer redis({RIDGECAST_REDIS_CONF});
  const std::string place = "127.0.0.1:" + std::to_string(redis.port());
  const Redis::Settings settings{"redis://ridgecast:change-this-password@" + place, {}, {}};
  useAll(settings);
  EXPECT_EQ(append(*connectTo(settings), 1, {"two", "three"}).kind, Kind::kDone);
  redis.kill();
  redis.start();
  EXPECT_THAT(all(*connectTo(settings)), ElementsAre("one", "two", "three")) << "they were acknowledged";
  EXPECT_THAT(refusal({"redis://ridgecast:wrong@" + place, {}, {}}), HasSubstr("refuses the user or the password (WRONGPASS"));
  EXPECT_THAT(refusal({"redis://" + place, {}, {}}), HasSubstr("a password may be missing (NOAUTH"));
  const testing_support::ScratchFolder folder;
  std::ofstream(folder / "password") << "change-this-password\n";
  EXPECT_EQ(refusal({"redis://ridgecast:@" + place, folder / "password", {}}).substr(0, 26), "The engine's URL must be l");
  EXPECT_EQ(refusal({"redis://ridgecast@" + place, folder / "password", {}}), "");
  EXPECT_THAT(refusal({"redis://ridgecast:x@" + place, folder / "password", {}}), HasSubstr("leave one of them out"));
  EXPECT_THAT(refusal({"redis://ridgecast@" + place, folder / "none", {}}), HasSubstr("must be readable"));
}

TEST_F(RedisBus, SpeaksTls) {
  testing_support::Authority authority;
  const auto issued = authority.issue("DNS:localhost,IP:127.0.0.1"), other = authority.issue("DNS:elsewhere.example");
  const auto tls = [&](const auto& certificate) {
    return std::vector<std::string>{"--port",
                                    "0",
                                    "--tls-port",
                                    "PORT",
                                    "--tls-cert-file",
                                    certificate.certificate,
                                    "--tls-key-file",
                                    certificate.key,
                                    "--tls-ca-cert-file",
                                    authority.certificate(),
                                    "--tls-auth-clients",
                                    "no"};
  };
  const RedisServer redis(tls(issued)), elsewhere(tls(other));
  const std::string place = "127.0.0.1:" + std::to_string(redis.port());
  useAll({"rediss://" + place, {}, authority.certificate()});
  EXPECT_THAT(refusal({"rediss://" + place, {}, {}}), HasSubstr("name its authority with --shared-ca FILE"));
  EXPECT_THAT(refusal({"rediss://127.0.0.1:" + std::to_string(elsewhere.port()), {}, authority.certificate()}),
              HasSubstr("is not for '127.0.0.1'"));
  EXPECT_NE(refusal({"redis://" + place, {}, {}}), "");
}

TEST_F(RedisBus, RefusesAnEngineThatLosesOrEvicts) {
  const RedisServer redis;
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"appendfsync", "everysec"}, {"no-appendfsync-on-rewrite", "yes"}, {"maxmemory-policy", "allkeys-lru"}, {"appendonly", "no"}};
  for (const auto& [name, value] : wrong) {
    const std::string before = redis.command({"CONFIG", "GET", name});
    redis.command({"CONFIG", "SET", name, value});
    EXPECT_THAT(refusal({redis.url(), {}, {}}),
                testing::AllOf(HasSubstr("for it has " + name + " " + value), HasSubstr("appendfsync always")));
    std::string right = before.substr(before.find('\n') + 1);
    right.pop_back();
    redis.command({"CONFIG", "SET", name, right});
  }
  EXPECT_EQ(refusal({redis.url(), {}, {}}), "");
  EXPECT_THAT(refusal({"redis://127.0.0.1:" + std::to_string(testing_support::freePort()), {}, {}}), HasSubstr("cannot be reached"));
  const RedisServer replica({"--replicaof", "127.0.0.1 " + std::to_string(redis.port())});
  EXPECT_THAT(refusal({replica.url(), {}, {}}), HasSubstr("it is a replica"));
}

// It was there, and is stopped in the midst of all; the machine goes on.
TEST_F(RedisBus, LosesNothingWhileTheEngineIsStopped) {
  RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}});
  ASSERT_EQ(append(*a, 0, {"one"}).kind, Kind::kDone);
  redis.pause();
  const Answer<Appended> hangs;
  a->append("log", 1, {"two"}, Bus::Origin::kNew, hangs.take());
  ASSERT_TRUE(awaitSoon([&] { return hangs.has(); }));
  EXPECT_EQ(hangs.get().kind, Kind::kUnknown);
  EXPECT_TRUE(a->isAway());
  EXPECT_EQ(append(*a, 1, {"two"}).kind, Kind::kAway);
  redis.resume();
  ASSERT_TRUE(awaitSoon([&] { return !a->isAway(); }));
  // The first is there or not; it was sent before this.
  const Appended next = append(*a, 1, {"three"});
  EXPECT_TRUE(next.kind == Kind::kDone || next.kind == Kind::kBehind) << testing::PrintToString(next);
  EXPECT_THAT(all(*a), ElementsAre("one", next.kind == Kind::kDone ? "three" : "two"));
}

TEST_F(RedisBus, GoesOnWhenItsScriptsAreForgotten) {
  const RedisServer redis;
  const auto figures = std::make_shared<metrics::Metrics>();
  const auto a = connectTo({redis.url(), {}, {}}, figures);
  ASSERT_EQ(append(*a, 0, {"one"}).kind, Kind::kDone);
  EXPECT_THAT(figures->registry.text(), HasSubstr("ridgecast_bus_connected 1\n"));
  redis.command({"SCRIPT", "FLUSH"});
  EXPECT_EQ(append(*a, 1, {"two"}).kind, Kind::kAway);
  ASSERT_TRUE(awaitSoon([&] { return append(*a, 1, {"two"}).kind == Kind::kDone; }));
  EXPECT_THAT(figures->registry.text(), testing::AllOf(HasSubstr("ridgecast_bus_reconnects_total 1\n"),
                                                       HasSubstr("ridgecast_bus_calls_total{call=\"append\",result=\"done\"} 2\n"),
                                                       HasSubstr("ridgecast_bus_append_seconds_count ")));
}

// A disk without room ends a Redis that syncs always; what it had acknowledged is there when it has room again.
TEST_F(RedisBus, LosesNothingWhenTheDiskIsFull) {
  RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}});
  std::vector<std::string> done;
  const rlimit small{1 << 20, RLIM_INFINITY};
  ASSERT_EQ(prlimit(redis.id(), RLIMIT_FSIZE, &small, nullptr), 0);
  for (int i = 0;; ++i) {
    ASSERT_LT(i, 1000);
    const std::string entry = std::to_string(i) + std::string(10'000, 'x');
    const Appended appended = append(*a, done.size(), {entry});
    if (appended.kind != Kind::kDone) {
      EXPECT_EQ(appended.kind, Kind::kUnknown);
      break;
    }
    done.push_back(entry);
  }
  ASSERT_TRUE(awaitSoon([&] { return !redis.isRunning(); }));
  EXPECT_EQ(append(*a, done.size(), {"no"}).kind, Kind::kAway);
  redis.start();
  ASSERT_TRUE(awaitSoon([&] { return !a->isAway(); }));
  auto there = all(*a);
  ASSERT_GE(there.size(), done.size());
  there.resize(done.size());
  EXPECT_EQ(there, done);
}

TEST_F(RedisBus, TellsWhatItsEngineHasLostInTheMiddle) {
  const RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}});
  ASSERT_EQ(append(*a, 0, {"one", "two", "three"}).kind, Kind::kDone);
  redis.command({"XDEL", "ridgecast:log:log", "2-0"});
  for (const auto& [after, entry] : {std::pair(0, Entry{1, "one"}), std::pair(1, Entry{2, ""}), std::pair(2, Entry{3, "three"})}) {
    const Answer<Outcome<std::vector<Entry>>> page;
    a->read("log", static_cast<std::uint64_t>(after), 1 << 20, page.take());
    ASSERT_TRUE(awaitSoon([&] { return page.has(); }));
    ASSERT_TRUE(page.get());
    EXPECT_THAT(*page.get(), testing::ElementsAre(entry)) << after;
  }
}

// Edits without end leave room for what sessions need to go on.
TEST_F(RedisBus, KeepsRoomForSmallRecords) {
  const RedisServer redis({"--maxmemory", "8mb"});
  const auto figures = std::make_shared<metrics::Metrics>();
  const auto a = connectTo({redis.url(), {}, {}}, figures);
  const std::string entry(20'000, 'x');
  Appended appended;
  ASSERT_TRUE(awaitSoon([&] {
    for (int k = 0; k < 5 && appended.kind == Kind::kDone; ++k) appended = append(*a, appended.last, {entry});
    return appended.kind != Kind::kDone;
  }));
  EXPECT_EQ(appended.kind, Kind::kFull);
  EXPECT_GT(appended.last, 100u);
  // What was on its way counts for a second, and more may be left after that: from here on a thirty-second is.
  const std::string memory = redis.command({"INFO", "memory"}), name = "used_memory:";
  const std::uint64_t used = std::stoull(memory.substr(memory.find(name) + name.size()));
  const std::string limit = std::to_string(used + used / 31);
  redis.command({"CONFIG", "SET", "maxmemory", limit});
  ASSERT_TRUE(awaitSoon([&] { return figures->registry.text().find("\nridgecast_bus_memory_limit_bytes " + limit) != std::string::npos; }));
  ASSERT_TRUE(awaitSoon([&] { return (appended = append(*a, appended.last, {entry})).kind != Kind::kDone; }));
  EXPECT_EQ(appended.kind, Kind::kFull);
  EXPECT_THAT(appended.why, HasSubstr("less than a sixteenth of its memory is left"));
  for (int k = 0; k < 50; ++k) ASSERT_TRUE(hold(*a, "key" + std::to_string(k), std::string(300, 'v'), 0)) << k;
  EXPECT_FALSE(hold(*a, "mesh", std::string(100'000, 'v'), 0));
  redis.command({"CONFIG", "SET", "maxmemory", "16mb"});
  EXPECT_TRUE(awaitSoon([&] { return append(*a, appended.last, {entry}).kind == Kind::kDone; }));
}

// Of a snapshot that Redis cannot write, as with `save` set: it refuses all writes.
TEST_F(RedisBus, IsFullWhenTheEngineCannotSave) {
  const RedisServer redis({"--save", "3600 1", "--dbfilename", "dump"});
  std::filesystem::create_directory(redis.folder() / "dump");
  const auto a = connectTo({redis.url(), {}, {}});
  ASSERT_EQ(append(*a, 0, {"one"}).kind, Kind::kDone);
  redis.command({"BGSAVE"});
  Appended appended;
  ASSERT_TRUE(awaitSoon([&] { return (appended = append(*a, appended.last ? appended.last : 1, {"two"})).kind != Kind::kDone; }));
  EXPECT_EQ(appended.kind, Kind::kFull);
  EXPECT_THAT(appended.why, HasSubstr("MISCONF"));
  EXPECT_GE(appended.last, 1u);
}

TEST_F(RedisBus, BoundsWhatWaits) {
  RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}});
  const Appended tooLong = append(*a, 0, {std::string(Redis::kMaxAppendBytes, 'x')});
  EXPECT_EQ(tooLong.kind, Kind::kFull);
  EXPECT_THAT(tooLong.why, HasSubstr("16 MiB"));
  EXPECT_FALSE(hold(*a, "key", std::string(Redis::kMaxValueBytes + 1, 'x'), 0));
  EXPECT_TRUE(hold(*a, "key", std::string(Redis::kMaxValueBytes, 'x'), 0)->isYours);
  redis.pause();
  std::atomic<int> away = 0, other = 0, early = 0;
  const std::string part(1 << 20, 'x');
  for (int i = 0; i < 100; ++i)
    a->append("log", 0, {part}, Bus::Origin::kNew, [&](const Appended& appended) {
      if (appended.kind == Kind::kUnknown && !a->isAway()) ++early;
      ++(appended.kind == Kind::kAway ? away : other);
    });
  // At least what is beyond 64 MiB was never sent.
  ASSERT_TRUE(awaitSoon([&] { return away + other == 100; }));
  EXPECT_GE(away, 36);
  EXPECT_GT(other, 0);
  EXPECT_EQ(early, 0) << "who has no answer finds the engine away";
  redis.resume();
  ASSERT_TRUE(awaitSoon([&] { return !a->isAway(); }));
  EXPECT_EQ(append(*a, 7, {"behind"}).kind, Kind::kBehind);
}

TEST_F(RedisBus, EndsInItsOwnHandlerAndWithCallsUnderWay) {
  const RedisServer redis;
  auto own = connectTo({redis.url(), {}, {}});
  std::atomic<bool> ended = false;
  Bus* const bus = own.get();
  bus->append("log", 0, {"one"}, Bus::Origin::kNew, [&, mine = std::move(own)](const Appended& appended) mutable {
    EXPECT_EQ(appended.kind, Kind::kDone);
    mine.reset();
    ended = true;
  });
  ASSERT_TRUE(awaitSoon([&] { return ended.load(); }));
  for (int i = 0; i < 20; ++i) {
    const auto a = connectTo({redis.url(), {}, {}});
    const auto watching = a->watch("log", [](std::uint64_t) {});
    for (int n = 0; n < i; ++n) a->hold(std::to_string(n), "v", 0, 1h, [](const Outcome<Bus::Held>&) {});
    a->drop("0", 1);
  }
  // What was called before the end has reached the engine.
  const auto a = connectTo({redis.url(), {}, {}});
  const Answer<Outcome<std::map<std::string, Record>>> listed;
  a->list("", listed.take());
  ASSERT_TRUE(awaitSoon([&] { return listed.has(); }));
  EXPECT_EQ(listed.get()->size(), 19u);
}

TEST_F(RedisBus, KeepsDatabasesApart) {
  const RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}}), b = connectTo({redis.url() + "/1", {}, {}}), c = connectTo({redis.url() + "/1", {}, {}});
  const Heard<std::string> heard;
  const Heard<std::uint64_t> changed;
  const auto hearing = b->hear("channel", heard.take());
  const auto watching = b->watch("log", changed.take());
  ASSERT_TRUE(awaitSoon([&] { return changed.size() == 1; }));
  ASSERT_EQ(append(*a, 0, {"one"}).kind, Kind::kDone);
  a->tell("channel", "no");
  ASSERT_TRUE(hold(*a, "key", "a", 0)->isYours);
  EXPECT_TRUE(hold(*b, "key", "b", 0)->isYours);
  c->tell("channel", "yes");
  ASSERT_EQ(append(*c, 0, {"other"}).kind, Kind::kDone);
  ASSERT_TRUE(awaitSoon([&] { return changed.last() == 1u && heard.size() == 1; }));
  EXPECT_THAT(heard.all(), ElementsAre("yes"));
  EXPECT_EQ(changed.size(), 2u);
}

// An engine that has lost a lease's last holder gives nobody that epoch again, nor its servers' numbers.
TEST_F(RedisBus, GivesNoEpochAndNoNumberTwiceAfterALoss) {
  RealRedis engine;
  const auto a = engine.connect();
  engine.prepareLoss();
  const auto b = engine.connect();  // which the replica never sees
  ASSERT_EQ(hold(*a, "lease", "a", 0)->record.epoch, 1u);
  engine.loseEnd("", 0);
  ASSERT_TRUE(awaitSoon([&] { return !a->isAway() && !b->isAway(); }));
  const auto taken = hold(*b, "lease", "b", 0);
  ASSERT_TRUE(taken && taken->isYours);
  EXPECT_GT(taken->record.epoch, 1u);
  EXPECT_FALSE(hold(*a, "lease", "late", 1)->isYours);
  const auto c = engine.connect();
  EXPECT_NE(c->server(), a->server());
  EXPECT_NE(c->server(), b->server());
}

// The engine's time, not this machine's or another server's.
TEST_F(RedisBus, HasTheEnginesClock) {
  const RedisServer redis;
  const auto a = connectTo({redis.url(), {}, {}}), b = connectTo({redis.url(), {}, {}});
  const std::int64_t before = a->now(), engine = std::stoll(redis.command({"TIME"})) * 1'000'000, after = b->now();
  EXPECT_LE(before, engine + 1'500'000);
  EXPECT_GE(after, engine - 500'000);
  EXPECT_LE(before, after + 500'000);
}

}  // namespace
}  // namespace ridgecast::bus
