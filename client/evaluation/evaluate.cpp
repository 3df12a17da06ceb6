#include "client/evaluation/evaluate.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <system_error>
#include <thread>

#include "client/evaluation/fly.h"
#include "client/evaluation/own_server.h"
#include "client/evaluation/paths.h"
#include "client/evaluation/report.h"
#include "client/evaluation/views.h"

namespace ridgecast::evaluation {
namespace {

using Clock = std::chrono::steady_clock;

// Triangles: a view's mesh, settled, has at most 500,000, for a server fills its budget up to 98 %; a flight's never has more.
constexpr std::uint32_t kViewBudget = 510'000, kFlightBudget = 500'000;
constexpr double kFinest = 0.3;  // threshold of `area` at which the budget is what counts

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
}

struct Plan {
  Run run;
  bool popping = false, frames = false;
};

// Everything that the options leave open, decided.
struct Settings {
  bool quick;
  std::vector<std::string> terrains;
  std::vector<std::string> cameras;  // of the views
  bool views, flights;
  std::uint32_t width, height, supersample;
  int repeats;
  double seconds;  // of each path
};

Settings settingsOf(const EvaluateOptions& o) {
  const bool quick = o.quick;
  return {quick,
          o.terrains.empty() ? std::vector<std::string>{"alpine", "canyon", "archipelago"} : o.terrains,
          o.views.empty() ? std::vector<std::string>{"low", "overview", "grazing"} : o.views,
          o.only != "flights",
          o.only != "views",
          o.width.value_or(quick ? 480 : 1280),
          o.height.value_or(quick ? 270 : 720),
          o.supersample.value_or(2),
          o.repeats.value_or(quick ? 1 : 3),
          o.seconds.value_or(quick ? 3.0 : 1e9)};
}

// One line that says it all: a folder belongs to one of them.
std::string wordsOf(const Settings& s) {
  const auto joined = [](const std::vector<std::string>& names) {
    std::string out;
    for (const std::string& name : names) out += (out.empty() ? "" : ",") + name;
    return out;
  };
  const std::string terrains = joined(s.terrains), cameras = joined(s.cameras);
  char text[512];
  std::snprintf(text, sizeof text, "evaluate%s --terrains %s --views %s%s --size %ux%u --supersample %u --repeats %d%s",
                s.quick ? " --quick" : "", terrains.c_str(), cameras.c_str(),
                s.views && s.flights ? ""
                : s.views            ? " --only views"
                                     : " --only flights",
                s.width, s.height, s.supersample, s.repeats,
                s.seconds < 1e8 ? (" --seconds " + std::to_string(s.seconds).substr(0, 6)).c_str() : "");
  return text;
}

Run runOf(const std::string& terrain, const std::string& metric, double threshold, unsigned threads, int repeat,
          const std::string& more = {}) {
  char name[128];
  std::snprintf(name, sizeof name, "%s-%s-%g%s%s-r%d", terrain.c_str(), metric.c_str(), threshold,
                threads ? ("-" + std::to_string(threads) + "threads").c_str() : "", more.c_str(), repeat);
  return {name, terrain, metric, threshold, threads, repeat, {}};
}

std::vector<Plan> flightsOf(const Settings& s) {
  std::vector<Plan> out;
  if (!s.flights) return out;
  const unsigned cores = std::max(std::thread::hardware_concurrency(), 1u);
  const std::string& first = s.terrains.front();
  for (const std::string& terrain : s.terrains)
    for (const std::string& metric : {std::string("pixels"), std::string("thesis")})
      for (const double factor : s.quick ? std::vector<double>{1.0} : std::vector<double>{0.5, 1.0, 2.0}) {
        if (s.quick && metric == "thesis" && terrain != first) continue;
        for (int r = 1; r <= s.repeats; ++r) out.push_back({runOf(terrain, metric, factor * (metric == "pixels" ? 1 : 2e-5), 0, r)});
      }
  for (const std::string& terrain : s.terrains)
    for (int r = 1; r <= s.repeats; ++r) out.push_back({runOf(terrain, "area", kFinest, 0, r)});
  for (unsigned threads = 1; threads < cores; threads *= 2)
    for (int r = 1; r <= s.repeats; ++r) out.push_back({runOf(first, "pixels", 1, threads, r)});
  for (const std::string& terrain : s.quick ? std::vector<std::string>{first} : s.terrains) {
    out.push_back({runOf(terrain, "pixels", 1, 0, 1, "-frames"), false, true});
    out.push_back({runOf(terrain, "pixels", 1, 0, 1, "-standing"), true, false});
  }
  return out;
}

// At the server's own setting, at half of it, and with as many triangles as the budget has.
std::vector<MeshCase> meshesOf(const Settings& s) {
  if (s.quick) return {{"pixels", 1}, {"area", kFinest}};
  return {{"pixels", 1}, {"pixels", 0.5}, {"area", kFinest}};
}

std::string_view pathOf(const std::string& terrain) {
  return terrain == "alpine" ? paths::alpine : terrain == "canyon" ? paths::canyon : paths::archipelago;
}

wire::Metric metricOf(const std::string& name) {
  return name == "thesis" ? wire::Metric::kThesis : name == "area" ? wire::Metric::kArea : wire::Metric::kPixels;
}

std::string processorName() {
  std::ifstream in("/proc/cpuinfo");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("model name")) return line.substr(std::min(line.find(':') + 2, line.size()));
  return "an unknown processor";
}

// Load from elsewhere spoils times: said where it is noticed.
std::string loadWords() {
  double load = 0;
  std::ifstream("/proc/loadavg") >> load;
  char text[96];
  std::snprintf(text, sizeof text, "; load of the machine at the beginning %.1f", load);
  return text;
}

class Evaluation {
 public:
  Evaluation(const EvaluateOptions& options, Settings settings, std::filesystem::path server)
      : out_(options.out), settings_(std::move(settings)), server_(std::move(server)), flights_(flightsOf(settings_)) {
    for (const ViewCase& view : viewCases())
      if (settings_.views && std::ranges::count(settings_.terrains, view.terrain) && std::ranges::count(settings_.cameras, view.name))
        views_.push_back(view);
  }

  // The folder's own: what it was begun with, and on what.
  int begin() {
    const std::string words = wordsOf(settings_);
    const std::filesystem::path file = out_ / "options.txt";
    std::string known, machine;
    if (std::ifstream in(file); std::getline(in, known)) {
      std::getline(in, machine_);
      if (known != words)
        return fail(kBadInput,
                    out_.string() + " holds what '" + known + "' measured, not '" + words + "': choose another --out, or the same options");
      return kSuccess;
    }
    machine_ = std::string("ridgecast-client " RIDGECAST_VERSION ", commit " RIDGECAST_COMMIT "; ") + processorName() + ", " +
               std::to_string(std::thread::hardware_concurrency()) + " threads" + loadWords() + "; " + words;
    std::ofstream out(file, std::ios::trunc);
    out << words << "\n" << machine_ << "\n";
    out.close();
    return out ? kSuccess : fail(kBadInput, "cannot write " + file.string() + ": choose a folder that may be written and has room");
  }

  int measureViews() {
    for (const ViewCase& view : views_) {
      const std::filesystem::path folder = folderOf(view);
      announce(folder.filename().string());
      if (std::filesystem::exists(folder / "view.json")) continue;
      const std::filesystem::path path = folder / "path.json";
      if (const int code = prepare(folder, path, evaluation::pathOf(view)); code != kSuccess) return code;
      auto own = OwnServer::start(server_, {"--terrain", std::string(view.terrain), "--seed", "1"}, folder);
      if (!own) return fail(kRuntimeFailure, own.error().message);
      ViewSettings how;
      how.repeats = settings_.repeats;
      how.samples.clear();
      for (std::uint32_t n = 1; n <= settings_.supersample; n *= 2) how.samples.push_back(n);
      ViewMeasurement measurement(view, how, folder);
      for (const MeshCase& mesh : meshesOf(settings_)) {
        FlyOptions fly = common(**own, path, folder / "mesh");
        fly.settings = {metricOf(mesh.metric), mesh.threshold, kViewBudget};
        fly.atRest = [&](const AtRest& at) { return measurement.measure(mesh, at); };
        if (const int code = evaluation::fly(fly); code != kSuccess) return interrupted(code, folder.filename().string());
      }
      if (auto finished = measurement.finish(); !finished) return fail(kRuntimeFailure, finished.error().message);
    }
    return kSuccess;
  }

  int measureFlights() {
    for (Plan& plan : flights_) {
      Run& run = plan.run;
      run.folder = out_ / "flights" / run.name;
      announce(run.name);
      if (std::filesystem::exists(run.folder / "summary.json")) continue;
      const std::filesystem::path path = run.folder / "path.json";
      if (const int code = prepare(run.folder, path, pathOf(run.terrain)); code != kSuccess) return code;
      auto own = OwnServer::start(server_, {"--terrain", run.terrain, "--seed", "1", "--threads", std::to_string(run.threads)}, run.folder);
      if (!own) return fail(kRuntimeFailure, own.error().message);
      FlyOptions fly = common(**own, path, run.folder);
      fly.settings.metric = metricOf(run.metric);
      fly.settings.threshold = run.threshold;
      if (run.metric == "area") fly.settings.triangleBudget = kFlightBudget;
      fly.supersample = std::min(settings_.supersample, settings_.quick ? 1u : 2u);
      fly.corrected = fly.unfiltered = true;
      fly.measurePopping = plan.popping;
      fly.measureFrames = plan.frames;
      fly.seconds = plan.popping ? 0 : settings_.seconds;
      if (settings_.quick) fly.framesEvery = 1.5;
      // Pictures are the other flights'.
      if (plan.frames) fly.framesEvery = 1e9;
      if (const int code = evaluation::fly(fly); code != kSuccess) return interrupted(code, run.name);
    }
    return kSuccess;
  }

  int report() {
    std::vector<Run> runs;
    for (const Plan& plan : flights_) runs.push_back(plan.run);
    std::vector<std::filesystem::path> views;
    for (const ViewCase& view : views_) views.push_back(folderOf(view));
    if (auto written = writeReport(runs, views, out_, machine_); !written) return fail(kRuntimeFailure, written.error().message);
    std::fprintf(stderr, "%s, after %.0f s\n", (out_ / "report.html").c_str(), seconds());
    return kSuccess;
  }

 private:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }
  void announce(const std::string& what) {
    std::fprintf(stderr, "[%zu of %zu, %.0f s] %s\n", ++done_, views_.size() + flights_.size(), seconds(), what.c_str());
  }
  std::filesystem::path folderOf(const ViewCase& view) const {
    return out_ / "views" / (std::string(view.terrain) + "-" + std::string(view.name));
  }
  static int prepare(const std::filesystem::path& folder, const std::filesystem::path& path, std::string_view text) {
    std::error_code failed;
    std::filesystem::create_directories(folder, failed);
    std::ofstream out(path, std::ios::trunc);
    out << text;
    out.close();
    return out ? kSuccess : fail(kBadInput, "cannot write " + path.string() + ": choose a folder that may be written and has room");
  }
  static int interrupted(int code, const std::string& what) {
    return fail(code, what + " failed; run the same command again to go on from there");
  }
  FlyOptions common(const OwnServer& server, const std::filesystem::path& path, const std::filesystem::path& out) const {
    FlyOptions fly;
    fly.url.port = std::to_string(server.port());
    fly.path = path;
    fly.out = out;
    fly.width = settings_.width;
    fly.height = settings_.height;
    fly.settleLimit = settings_.quick ? 30 : 120;
    return fly;
  }

  std::filesystem::path out_;
  Settings settings_;
  std::filesystem::path server_;
  std::vector<Plan> flights_;
  std::vector<ViewCase> views_;
  std::string machine_;
  Clock::time_point began_ = Clock::now();
  std::size_t done_ = 0;
};

}  // namespace

int evaluate(const EvaluateOptions& options) {
  std::error_code failed;
  std::filesystem::create_directories(options.out, failed);
  if (failed) return fail(kBadInput, "cannot make the folder " + options.out.string() + ": " + failed.message());
  const std::filesystem::path server =
      options.server.empty() ? std::filesystem::read_symlink("/proc/self/exe", failed).parent_path() / "ridgecast-server" : options.server;
  Evaluation evaluation(options, settingsOf(options), server);
  if (const int code = evaluation.begin(); code != kSuccess) return code;
  if (const int code = evaluation.measureViews(); code != kSuccess) return code;
  if (const int code = evaluation.measureFlights(); code != kSuccess) return code;
  return evaluation.report();
}

}  // namespace ridgecast::evaluation
