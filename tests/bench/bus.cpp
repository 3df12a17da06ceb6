// ridgecast-bench bus: appends to a log by Redis, as edits are, each synced before it is answered: 256 bytes by one server and by sixteen,
// to a log of each and to one log for all, where whoever is behind tries again; and messages, 1 server to 3.
//
// Redis runs beside it with its data in the folder of temporary files: its disk is what is measured. Latency: from the call until its
// handler is called.
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "server/bus/redis.h"
#include "tests/bench/bench.h"
#include "tests/support/redis_server.h"

namespace ridgecast::bench {

namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

std::shared_ptr<bus::Bus> join(const testing_support::RedisServer& redis) {
  auto made = bus::Redis::connect({redis.url(), {}, {}}, std::make_shared<metrics::Metrics>());
  if (!made) throw std::runtime_error(made.error().message);
  return *made;
}

double milliseconds(Steady::duration time) { return std::chrono::duration<double, std::milli>(time).count(); }

double diskOf(const testing_support::RedisServer& redis) {
  const std::string info = redis.command({"INFO", "persistence"}), name = "\naof_current_size:";
  const auto at = info.find(name);
  if (at == info.npos) throw std::runtime_error("the engine does not say what it has on its disk");
  return std::stod(info.substr(at + name.size()));
}

// One server that appends again as soon as it has its answer.
struct Writer {
  std::shared_ptr<bus::Bus> bus;
  std::string log;
  Steady::time_point end;
  std::vector<double> took;  // of entries, with the tries that were behind
  std::uint64_t behind = 0;
  std::atomic<bool> isDone = false;

  void go(std::uint64_t after, Steady::time_point begun) {
    bus->append(log, after, {std::string(256, 'e')}, bus::Bus::Origin::kNew, [this, begun](const bus::Appended& appended) {
      const auto now = Steady::now();
      if (appended.kind == bus::Appended::Kind::kBehind) {
        ++behind;
        return go(appended.last, begun);
      }
      if (appended.kind != bus::Appended::Kind::kDone) throw std::runtime_error("an append failed: " + appended.why);
      took.push_back(milliseconds(now - begun));
      if (now < end)
        go(appended.last, now);
      else
        isDone = true;
    });
  }
};

void appends(Report& report, const testing_support::RedisServer& redis, const std::string& name, int servers, bool oneLog,
             std::chrono::seconds length) {
  const double disk = diskOf(redis);
  std::vector<Writer> writers(static_cast<std::size_t>(servers));
  for (std::size_t i = 0; i < writers.size(); ++i) {
    writers[i].bus = join(redis);
    writers[i].log = name + (oneLog ? "" : std::to_string(i));
  }
  const auto begun = Steady::now();
  for (Writer& writer : writers) {
    writer.end = begun + length;
    writer.go(0, begun);
  }
  for (const Writer& writer : writers)
    while (!writer.isDone) std::this_thread::sleep_for(1ms);
  const double seconds = milliseconds(Steady::now() - begun) / 1000;
  std::vector<double> all;
  std::uint64_t behind = 0;
  for (const Writer& writer : writers) {
    all.insert(all.end(), writer.took.begin(), writer.took.end());
    behind += writer.behind;
  }
  report.add(name + "_per_second", static_cast<double>(all.size()) / seconds, "appends a second");
  report.add(name + "_p50_ms", percentile(all, 0.5), "ms");
  report.add(name + "_p99_ms", percentile(all, 0.99), "ms");
  if (servers == 1) {
    const auto count = static_cast<double>(all.size());
    const double memory = std::stod(redis.command({"MEMORY", "USAGE", "ridgecast:log:" + name, "SAMPLES", "0"}));
    report.add(name + "_memory_bytes", memory / count, "of the engine, an entry");
    report.add(name + "_disk_bytes", (diskOf(redis) - disk) / count, "before it is rewritten");
  }
  if (oneLog && servers > 1)
    report.add(name + "_behind", static_cast<double>(behind) / static_cast<double>(all.size()), "lost races an append");
}

// 2,000 members at 10 Hz on four servers are 20 messages of 128 kB a second from each: here from one.
void messages(Report& report, const testing_support::RedisServer& redis, int count) {
  const auto from = join(redis);
  std::vector<std::shared_ptr<bus::Bus>> to;
  std::vector<bus::Subscription> hearing;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<double> took;
  Steady::time_point sent;
  int ready = 0;
  for (int i = 0; i < 3; ++i) {
    to.push_back(join(redis));
    hearing.push_back(to.back()->hear("bench", [&](const std::string&) {
      const std::lock_guard lock(mutex);
      took.push_back(milliseconds(Steady::now() - sent));
      changed.notify_all();
    }));
    hearing.push_back(to.back()->watch("bench", [&](std::uint64_t) {  // its answer shows that the engine knows of the other
      const std::lock_guard lock(mutex);
      ++ready;
      changed.notify_all();
    }));
  }
  std::unique_lock lock(mutex);
  changed.wait(lock, [&] { return ready == 3; });
  for (int i = 0; i < count; ++i) {
    sent = Steady::now();
    from->tell("bench", std::string(128'000, 'm'));
    changed.wait(lock, [&] { return took.size() == 3 * static_cast<std::size_t>(i + 1); });
  }
  report.add("message_p50_ms", percentile(took, 0.5), "ms, 128 kB to 3 servers");
  report.add("message_p99_ms", percentile(took, 0.99), "ms");
}

}  // namespace

Report bus(const Options& options) {
  const auto length = options.quick ? 1s : 5s;
  const testing_support::RedisServer redis;
  Report report;
  appends(report, redis, "one", 1, true, length);
  appends(report, redis, "sixteen", 16, false, length);
  appends(report, redis, "shared", 4, true, length);
  messages(report, redis, options.quick ? 50 : 500);
  return report;
}

}  // namespace ridgecast::bench
