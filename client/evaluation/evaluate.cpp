#include "client/evaluation/evaluate.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/evaluation/fly.h"
#include "client/evaluation/own_server.h"
#include "client/evaluation/paths.h"
#include "client/evaluation/report.h"

namespace ridgecast::evaluation {
namespace {

using Clock = std::chrono::steady_clock;

struct Plan {
  Run run;
  bool popping = false;
};

Run runOf(const std::string& terrain, const std::string& metric, double threshold, unsigned threads, int repeat,
          const std::string& more = {}) {
  char name[128];
  std::snprintf(name, sizeof name, "%s-%s-%g%s%s-r%d", terrain.c_str(), metric.c_str(), threshold,
                threads ? ("-" + std::to_string(threads) + "threads").c_str() : "", more.c_str(), repeat);
  return {name, terrain, metric, threshold, threads, repeat, {}};
}

std::vector<Plan> planOf(bool quick) {
  std::vector<Plan> out;
  const unsigned cores = std::max(std::thread::hardware_concurrency(), 1u);
  const int repeats = quick ? 1 : 3;
  for (const char* terrain : {"alpine", "canyon", "archipelago"})
    for (const std::string& metric : {std::string("pixels"), std::string("thesis")})
      for (const double factor : quick ? std::vector<double>{1.0} : std::vector<double>{1.0, 2.0, 4.0}) {
        if (quick && metric == "thesis" && std::string_view(terrain) != "alpine") continue;
        for (int r = 1; r <= repeats; ++r) out.push_back({runOf(terrain, metric, factor * (metric == "pixels" ? 1 : 2e-5), 0, r), false});
      }
  if (quick) out.push_back({runOf("alpine", "pixels", 3, 0, 1), false});
  for (unsigned threads = 1; threads < cores; threads *= 2)
    for (int r = 1; r <= repeats; ++r) out.push_back({runOf("alpine", "pixels", 1, threads, r), false});
  for (const std::string& terrain : quick ? std::vector<std::string>{"alpine"} : std::vector<std::string>{"alpine", "canyon", "archipelago"})
    out.push_back({runOf(terrain, "pixels", 1, 0, 1, "-standing"), true});
  return out;
}

std::string_view pathOf(const std::string& terrain) {
  return terrain == "alpine" ? paths::alpine : terrain == "canyon" ? paths::canyon : paths::archipelago;
}

std::string processorName() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("model name")) return line.substr(std::min(line.find(':') + 2, line.size()));
  return "an unknown processor";
}

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
}

}  // namespace

int evaluate(const EvaluateOptions& options) {
  std::error_code failed;
  std::filesystem::create_directories(options.out, failed);
  if (failed) return fail(kBadInput, "cannot make the folder " + options.out.string() + ": " + failed.message());
  const std::filesystem::path server =
      options.server.empty() ? std::filesystem::read_symlink("/proc/self/exe", failed).parent_path() / "ridgecast-server" : options.server;
  std::vector<Plan> plans = planOf(options.quick);
  const auto began = Clock::now();
  std::size_t done = 0;
  for (Plan& plan : plans) {
    Run& run = plan.run;
    run.folder = options.out / (options.quick ? "quick" : "full") / run.name;
    std::fprintf(stderr, "[%zu of %zu, %.0f s] %s\n", ++done, plans.size(), std::chrono::duration<double>(Clock::now() - began).count(),
                 run.name.c_str());
    if (std::filesystem::exists(run.folder / "summary.json", failed)) continue;
    std::filesystem::create_directories(run.folder, failed);
    const std::filesystem::path path = run.folder / "path.json";
    std::ofstream(path) << pathOf(run.terrain);
    std::vector<std::string> arguments{"--terrain", run.terrain, "--seed", "1", "--threads", std::to_string(run.threads)};
    auto own = OwnServer::start(server, arguments, run.folder);
    if (!own) return fail(kRuntimeFailure, own.error().message);
    FlyOptions fly;
    fly.url.port = std::to_string((*own)->port());
    fly.path = path;
    fly.out = run.folder;
    fly.settings.metric = run.metric == "thesis" ? wire::Metric::kThesis : wire::Metric::kPixels;
    fly.settings.threshold = run.threshold;
    fly.measurePopping = plan.popping;
    if (options.quick) {
      fly.width = 480;
      fly.height = 270;
      fly.rate = 2;
      fly.seconds = 3;
      fly.framesEvery = 1.5;
      fly.settleLimit = 30;
    } else {
      fly.supersample = 2;
    }
    if (plan.popping) fly.seconds = 0;
    if (const int code = evaluation::fly(fly); code != kSuccess)
      return fail(code, run.name + " failed; run the same command again to go on from there");
  }
  std::vector<Run> runs;
  for (const Plan& plan : plans) runs.push_back(plan.run);
  const std::string machine = std::string("ridgecast-client " RIDGECAST_VERSION ", commit " RIDGECAST_COMMIT "; ") + processorName() +
                              ", " + std::to_string(std::thread::hardware_concurrency()) + " threads; evaluate" +
                              (options.quick ? " --quick" : "");
  if (auto written = writeReport(runs, options.out, machine); !written) return fail(kRuntimeFailure, written.error().message);
  std::fprintf(stderr, "%s, after %.0f s\n", (options.out / "report.html").c_str(),
               std::chrono::duration<double>(Clock::now() - began).count());
  return kSuccess;
}

}  // namespace ridgecast::evaluation
