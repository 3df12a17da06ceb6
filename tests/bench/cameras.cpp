// Many cameras on one server: real sockets to a real server process, all on this machine, load generator included.
//
//   ridgecast-bench cameras [--count N] [--leave N] [--seconds S] [--budget TRIANGLES] [--rest] [--threads N] [--bytes-per-second N]
//                           [--table] [--plot FILE.svg]
//
// Each camera flies straight on at 50 m/s, 120 m above the ground, on a line of its own, and sends ten poses a second; --rest: it stands
// still. --leave: afterwards so many hang up and the others stop, until all are settled. The generator is one thread that parses what comes
// and acknowledges with the hash it was told; tests elsewhere hold the mesh.
#include <sys/epoll.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/terrain/terrain.h"
#include "tests/bench/bench.h"
#include "tests/bench/line.h"
#include "tests/bench/panels.h"
#include "tests/bench/usage.h"
#include "tests/support/flight.h"
#include "tests/support/server_process.h"

namespace ridgecast::bench {
namespace {

using Time = std::chrono::steady_clock;
constexpr std::size_t kNewcomers = 9;

struct Plan {
  int count = 32, leave = 0;
  double seconds = 20, warmUp = 8;
  std::uint32_t budget = 100'000;
  std::uint64_t bytesPerSecond = 0;
  double interval = 0.1;
  bool rest = false, table = false;
  std::string plot;  // file
  std::vector<std::string> server;
};

// Lines a kilometre apart, each camera in its own direction.
void fly(Line& line, int index, const Plan& plan, const terrain::Terrain& terrain) {
  if (!line.open()) return;
  const double t = plan.rest ? 0 : line.age(), yaw = index * 2.399963;
  line.pose(testing_support::cameraAt(terrain, 1000.0 * (index % 8) - 50 * t * std::sin(yaw),
                                      1000.0 * static_cast<int>(index / 8) - 50 * t * std::cos(yaw), 120, yaw, -0.15));
}

Report measure(const Plan& plan, const Options& options) {
  const auto terrain = terrain::create("alpine", 1);
  if (!terrain) throw std::runtime_error(terrain.error().message);
  const std::string many = std::to_string(plan.count + 8);
  std::vector<std::string> arguments{
      "--max-cameras",         many,           "--max-members", many, "--max-connections", many, "--max-connections-per-address", many,
      "--max-total-triangles", "1000000000000"};
  arguments.insert(arguments.end(), plan.server.begin(), plan.server.end());
  testing_support::ServerProcess server(options.programFolder + "/ridgecast-server", arguments);
  const pid_t pid = server.process().id();

  const int poll = ::epoll_create1(0);
  std::vector<std::unique_ptr<Line>> lines;
  std::vector<Time::time_point> next;
  double measuredFrom = 0, serverCpu = 0, ownCpu = 0;
  bool measuring = false;
  const Clock clock;
  // Cameras join one after the other, all within two seconds (a hundred a second at rest).
  const double joining = plan.rest ? plan.count / 100.0 : std::min(2.0, 0.05 * plan.count), warm = joining + plan.warmUp;
  const auto join = [&] {
    const int k = static_cast<int>(lines.size());
    lines.push_back(std::make_unique<Line>(server.port(), "camera " + std::to_string(k), plan.budget, plan.bytesPerSecond));
    next.push_back(Time::now() +
                   std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(plan.interval * (1 + (k % 16) / 16.0))));
    epoll_event event{};
    event.events = EPOLLIN;
    event.data.u32 = static_cast<std::uint32_t>(k);
    ::epoll_ctl(poll, EPOLL_CTL_ADD, lines.back()->socket(), &event);
  };
  // Those that are due send a pose, and what has come within a millisecond is taken.
  const auto serve = [&](bool flies) {
    if (flies)
      for (std::size_t k = 0; k < lines.size(); ++k)
        if (Time::now() >= next[k]) {
          next[k] += std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(plan.interval));
          fly(*lines[k], static_cast<int>(k), plan, **terrain);
        }
    epoll_event events[64];
    const int n = ::epoll_wait(poll, events, 64, 1);
    for (int k = 0; k < n; ++k) {
      if (events[k].data.u32 >= lines.size()) continue;
      Line& line = *lines[events[k].data.u32];
      const bool opens = !line.open();
      line.receive();
      if (opens) fly(line, static_cast<int>(events[k].data.u32), plan, **terrain);
    }
  };
  for (;;) {
    const double now = clock.seconds();
    if (!measuring && now >= warm) {
      measuring = true;
      measuredFrom = now;
      serverCpu = cpuSeconds(pid);
      ownCpu = cpuSeconds();
      for (auto& line : lines) line->restart();
    }
    if (measuring && now - measuredFrom >= plan.seconds) break;
    while (static_cast<int>(lines.size()) < plan.count && now >= joining * static_cast<double>(lines.size()) / plan.count) join();
    serve(!plan.rest);
  }
  const double seconds = clock.seconds() - measuredFrom;
  const double serverUsed = cpuSeconds(pid) - serverCpu, generatorUsed = cpuSeconds() - ownCpu;
  Report report;
  std::vector<double> rates, latencies, thresholds, bytes, coarse;
  double sum = 0, squares = 0, encode = 0, total = 0, settled = 0;
  for (const auto& line : lines) {
    const double rate = static_cast<double>(line->iterations) / seconds;
    rates.push_back(rate);
    sum += rate;
    squares += rate * rate;
    latencies.insert(latencies.end(), line->latencies.begin(), line->latencies.end());
    thresholds.insert(thresholds.end(), line->thresholds.begin(), line->thresholds.end());
    bytes.push_back(static_cast<double>(line->bytes) / seconds);
    coarse.push_back(line->coarseMs);
    encode += line->encodeMs;
    total += line->totalMs;
    settled += line->settled;
  }
  report.add("cameras", plan.count);
  report.add("iterations_per_second", *std::min_element(rates.begin(), rates.end()));
  report.add("median_iterations_per_second", median(rates));
  report.add("p50_ms", percentile(latencies, 0.5), "ms");
  report.add("p99_ms", percentile(latencies, 0.99), "ms");
  report.add("threshold_p50_px", percentile(thresholds, 0.5), "px");
  report.add("threshold_p99_px", percentile(thresholds, 0.99), "px");
  report.add("fairness", squares > 0 ? sum * sum / (static_cast<double>(rates.size()) * squares) : 1);
  report.add("server_rss_mib", residentBytes(pid) / (1 << 20), "MiB");
  report.add("server_cores", serverUsed / seconds);
  report.add("generator_cores", generatorUsed / seconds);
  report.add("bytes_per_second", median(bytes), "B/s");
  report.add("encode_share", total > 0 ? encode / total : 0);
  report.add("first_view_ms", median(coarse), "ms");
  if (plan.rest) report.add("at_rest", settled);
  // One more at a time, each while all others fly on.
  std::vector<double> later;
  for (const Clock since; later.size() < kNewcomers && since.seconds() < 60; lines.pop_back(), next.pop_back()) {
    join();
    while (lines.back()->coarseMs == 0 && since.seconds() < 60) serve(!plan.rest);
    later.push_back(lines.back()->coarseMs);
  }
  report.add("newcomer_first_view_ms", median(later), "ms");
  report.add("newcomer_first_view_worst_ms", std::ranges::max(later), "ms");
  if (plan.leave > 0) {
    lines.resize(static_cast<std::size_t>(std::max(1, plan.count - plan.leave)));
    const double left = clock.seconds();
    for (std::size_t k = 0; k < lines.size(); ++k) fly(*lines[k], static_cast<int>(k), plan, **terrain);
    const auto isSettled = [](const auto& line) { return line->answered() && line->settled; };
    while (!std::ranges::all_of(lines, isSettled) && clock.seconds() < left + 60) serve(false);
    report.add("settled_after_s", clock.seconds() - left, "s");
  }
  ::close(poll);
  report.note(std::to_string(plan.count) + (plan.rest ? " cameras at rest" : " cameras at 50 m/s, ten poses a second each") + ", budget " +
              std::to_string(plan.budget) + " triangles, " + std::to_string(std::lround(seconds)) + " s, after " +
              std::to_string(std::lround(warm)) + " s; " + std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) +
              " cores for server and generator");
  return report;
}

// The curve over the number of cameras, as rows of a Markdown table, and drawn.
Report curve(const Plan& plan, const Options& options) {
  Report last;
  std::vector<double> counts;
  std::map<std::string, std::vector<double>> figures;
  std::printf(
      "| cameras | iterations/s slowest | median | p50 ms | p99 ms | error px p50 | p99 | fairness | B/s each | encoding | server MiB | "
      "server cores |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (int count = 1; count <= plan.count; count *= 2) {
    Plan one = plan;
    one.count = count;
    last = measure(one, options);
    counts.push_back(count);
    for (const Figure& f : last.figures) figures[f.name].push_back(f.value);
    const auto of = [&](const char* name) { return figures.at(name).back(); };
    std::printf("| %d | %.1f | %.1f | %.0f | %.0f | %.2f | %.1f | %.3f | %.0f | %.0f %% | %.0f | %.2f |\n", count,
                of("iterations_per_second"), of("median_iterations_per_second"), of("p50_ms"), of("p99_ms"), of("threshold_p50_px"),
                of("threshold_p99_px"), of("fairness"), of("bytes_per_second"), 100 * of("encode_share"), of("server_rss_mib"),
                of("server_cores"));
    std::fflush(stdout);
  }
  if (plan.plot.empty()) return last;
  const std::vector<Panel> panels{
      {"Iterations a second",
       {{"slowest camera", figures["iterations_per_second"]}, {"median", figures["median_iterations_per_second"]}},
       true,
       10,
       "ten poses a second"},
      {"From pose to mesh, ms", {{"p50", figures["p50_ms"]}, {"p99", figures["p99_ms"]}}, true, 150, "150 ms"},
      {"Bytes a second, each camera", {{"", figures["bytes_per_second"]}}, false, 0, ""},
      {"The server's processor time, cores", {{"", figures["server_cores"]}}, false, 0, ""},
      {"The server's memory, MiB", {{"", figures["server_rss_mib"]}}, false, 0, ""},
      {"From connection to the first full view, ms", {{"", figures["first_view_ms"]}}, false, 200, "200 ms"}};
  std::ofstream(plan.plot) << drawPanels(last.notes.front().substr(last.notes.front().find(' ') + 1), "cameras", counts, panels);
  return last;
}

}  // namespace

Report cameras(const Options& options) {
  Plan plan;
  bool seconds = false;
  for (std::size_t k = 0; k < options.arguments.size(); ++k) {
    const std::string& name = options.arguments[k];
    const auto value = [&]() -> std::string {
      if (k + 1 >= options.arguments.size()) throw std::runtime_error(name + " needs a value");
      return options.arguments[++k];
    };
    if (name == "--count")
      plan.count = std::max(1, std::atoi(value().c_str()));
    else if (name == "--leave")
      plan.leave = std::max(0, std::atoi(value().c_str()));
    else if (name == "--seconds")
      plan.seconds = std::max(0.1, std::atof(value().c_str())), seconds = true;
    else if (name == "--budget")
      plan.budget = static_cast<std::uint32_t>(std::atoll(value().c_str()));
    else if (name == "--bytes-per-second")
      plan.bytesPerSecond = static_cast<std::uint64_t>(std::atoll(value().c_str()));
    else if (name == "--threads")
      plan.server = {"--threads", value()};
    else if (name == "--rest")
      plan.rest = true;
    else if (name == "--table")
      plan.table = true;
    else if (name == "--plot")
      plan.table = true, plan.plot = value();
    else
      throw std::runtime_error("cameras does not know " + name);
  }
  if (options.quick) {
    plan.warmUp = 2;
    if (!seconds) plan.seconds = 3;
  }
  return plan.table ? curve(plan, options) : measure(plan, options);
}

}  // namespace ridgecast::bench
