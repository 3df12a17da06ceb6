#include "client/evaluation/evaluate.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <system_error>
#include <thread>
#include <utility>

#include "client/evaluation/fly.h"
#include "client/evaluation/others.h"
#include "client/evaluation/own_server.h"
#include "client/evaluation/paths.h"
#include "client/evaluation/plan.h"
#include "client/evaluation/report.h"
#include "client/evaluation/views.h"
#include "common/settings/settings.h"
#include "common/version/version.h"

namespace ridgecast::evaluation {
namespace {

using Clock = std::chrono::steady_clock;

// Triangles: a view's mesh, settled, has at most 500,000, for a server fills its budget up to 98 %; a flight's never has more.
constexpr std::uint32_t kViewBudget = 510'000, kFlightBudget = 500'000;
constexpr std::size_t kMostReferences = 32;  // of one terrain: a flight's pictures and more

int fail(int code, const std::string& message) {
  std::fprintf(stderr, "ridgecast-client: %s\n", message.c_str());
  return code;
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

class Evaluation {
 public:
  Evaluation(const EvaluateOptions& options, Plan plan, std::filesystem::path server)
      : out_(options.out), plan_(std::move(plan)), server_(std::move(server)) {}

  // The folder's own: what it was begun with, and on what.
  int begin() {
    const std::string& words = plan_.words;
    const std::filesystem::path file = out_ / "options.txt";
    std::string known, machine;
    if (std::ifstream in(file); std::getline(in, known)) {
      std::getline(in, machine_);
      if (known != words)
        return fail(kBadInput,
                    out_.string() + " holds what '" + known + "' measured, not '" + words + "': choose another --out, or the same options");
      return kSuccess;
    }
    machine_ = "ridgecast-client " + std::string(version::product()) + ", commit " + std::string(version::commit()) + "; " +
               processorName() + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads; " + words;
    std::ofstream out(file, std::ios::trunc);
    out << words << "\n" << machine_ << "\n";
    out.close();
    return out ? kSuccess : fail(kBadInput, "cannot write " + file.string() + ": choose a folder that may be written and has room");
  }

  int measureViews() {
    for (const PlannedView& planned : plan_.views) {
      const ViewCase& view = planned.view;
      const std::filesystem::path folder = folderOf(view);
      if (!begins(folder.filename().string(), resultOf(view), planned.cost)) continue;
      const Others others;
      const std::filesystem::path path = folder / "path.json";
      if (const int code = prepare(folder, path, evaluation::pathOf(view)); code != kSuccess) return code;
      ViewSettings how;
      how.samples = plan_.samples;
      how.repeats = plan_.repeats;
      how.marches = (plan_.repeats + static_cast<int>(plan_.meshes.size()) - 1) / static_cast<int>(plan_.meshes.size());
      ViewMeasurement measurement(view, how, folder);
      {
        auto own = OwnServer::start(server_, {"--terrain", std::string(view.terrain), "--seed", "1"}, folder);
        if (!own) return fail(kRuntimeFailure, own.error().message);
        for (const MeshCase& mesh : plan_.meshes) {
          FlyOptions fly = common(**own, path, folder / "mesh");
          fly.settings = {settings::metricNamed(mesh.metric).value(), mesh.threshold, kViewBudget};
          fly.atRest = [&](const AtRest& at) { return measurement.measure(mesh, at); };
          if (const int code = evaluation::fly(fly); code != kSuccess) return interrupted(code, folder.filename().string());
        }
      }
      if (const int code = ends(folder, others); code != kSuccess) return code;
      if (auto finished = measurement.finish(); !finished) return fail(kRuntimeFailure, finished.error().message);
      measured(planned.cost);
    }
    return kSuccess;
  }

  int measureFlights() {
    for (PlannedFlight& planned : plan_.flights) {
      Run& run = planned.run;
      run.folder = folderOf(run);
      if (std::exchange(over_, run.terrain) != run.terrain) references_.clear();
      if (!begins(run.name, resultOf(run), planned.cost)) continue;
      const Others others;
      const std::filesystem::path path = run.folder / "path.json";
      if (const int code = prepare(run.folder, path, pathOf(run.terrain)); code != kSuccess) return code;
      {
        auto own =
            OwnServer::start(server_, {"--terrain", run.terrain, "--seed", "1", "--threads", std::to_string(run.threads)}, run.folder);
        if (!own) return fail(kRuntimeFailure, own.error().message);
        FlyOptions fly = common(**own, path, run.folder);
        fly.settings = {settings::metricNamed(run.metric).value(), run.threshold, kFlightBudget};
        fly.corrected = fly.unfiltered = fly.pictures = planned.pictures;
        fly.framesEvery = plan_.framesEvery;
        fly.references = &references_;
        fly.measurePopping = planned.popping;
        fly.measureFrames = planned.frames;
        fly.seconds = planned.seconds;
        if (const int code = evaluation::fly(fly); code != kSuccess) return interrupted(code, run.name);
      }
      if (const int code = ends(run.folder, others); code != kSuccess) return code;
      measured(planned.cost);
    }
    return kSuccess;
  }

  int report() {
    std::vector<Run> runs;
    for (PlannedFlight& planned : plan_.flights) {
      planned.run.folder = folderOf(planned.run);
      if (std::filesystem::exists(resultOf(planned.run))) runs.push_back(planned.run);
    }
    std::vector<std::filesystem::path> views;
    for (const PlannedView& planned : plan_.views)
      if (std::filesystem::exists(resultOf(planned.view))) views.push_back(folderOf(planned.view));
    if (runs.empty() && views.empty()) return fail(kBadInput, "nothing of it was measured yet in " + out_.string());
    const std::size_t all = plan_.flights.size() + plan_.views.size(), there = runs.size() + views.size();
    if (there < all) machine_.append("; ").append(std::to_string(there)).append(" of its ").append(std::to_string(all)).append(" parts");
    if (auto written = writeReport(runs, views, out_, machine_); !written) return fail(kRuntimeFailure, written.error().message);
    std::fprintf(stderr, "%s, after %.0f s\n", (out_ / "report.html").c_str(), seconds());
    return kSuccess;
  }

 private:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }

  // Whether it is to be measured; else it was.
  bool begins(const std::string& what, const std::filesystem::path& result, double cost) {
    ++number_;
    const bool there = std::filesystem::exists(result);
    if (there) planned_ += cost;
    std::fprintf(stderr, "[%zu of %zu, %.0f s%s] %s%s\n", number_, plan_.views.size() + plan_.flights.size(), seconds(), left().c_str(),
                 what.c_str(), there ? ": is there already" : "");
    return !there;
  }
  void measured(double cost) {
    planned_ += cost;
    spent_ += cost;
  }
  // What is left, at the pace of what was measured so far.
  std::string left() const {
    if (spent_ <= 0) return {};
    double all = 0;
    for (const PlannedView& v : plan_.views) all += v.cost;
    for (const PlannedFlight& f : plan_.flights) all += f.cost;
    char text[64];
    std::snprintf(text, sizeof text, ", some %.0f min left", std::ceil((all - planned_) * seconds() / spent_ / 60));
    return text;
  }
  // What the machine did beside it. Written last of a flight's files: it says that all are there.
  static int ends(const std::filesystem::path& folder, const Others& others) {
    const auto share = others.share();
    const std::filesystem::path file = folder / "machine.json";
    std::ofstream out(file, std::ios::trunc);
    out << "{\"others\": " << (share ? std::to_string(*share) : "null") << "}\n";
    out.close();
    return out ? kSuccess : fail(kBadInput, "cannot write " + file.string() + ": choose a folder that may be written and has room");
  }
  std::filesystem::path folderOf(const ViewCase& view) const {
    return out_ / "views" / (std::string(view.terrain) + "-" + std::string(view.name));
  }
  std::filesystem::path folderOf(const Run& run) const { return out_ / "flights" / run.name; }
  // There once all of it is.
  std::filesystem::path resultOf(const ViewCase& view) const { return folderOf(view) / "view.json"; }
  std::filesystem::path resultOf(const Run& run) const { return folderOf(run) / "machine.json"; }
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
    fly.width = plan_.width;
    fly.height = plan_.height;
    fly.settleLimit = plan_.quick ? 30 : 120;
    return fly;
  }

  std::filesystem::path out_;
  Plan plan_;
  std::filesystem::path server_;
  References references_{kMostReferences};
  std::string machine_, over_;  // the terrain that was flown over last
  Clock::time_point began_ = Clock::now();
  std::size_t number_ = 0;
  double planned_ = 0, spent_ = 0;  // costs of what is there, and of what was measured by now
};

}  // namespace

int evaluate(const EvaluateOptions& options) {
  std::error_code failed;
  std::filesystem::create_directories(options.out, failed);
  if (failed) return fail(kBadInput, "cannot make the folder " + options.out.string() + ": " + failed.message());
  const std::filesystem::path server =
      options.server.empty() ? std::filesystem::read_symlink("/proc/self/exe", failed).parent_path() / "ridgecast-server" : options.server;
  Evaluation evaluation(options, planOf(options, std::max(std::thread::hardware_concurrency(), 1u)), server);
  if (const int code = evaluation.begin(); code != kSuccess) return code;
  if (options.reportOnly) return evaluation.report();
  if (const int code = evaluation.measureViews(); code != kSuccess) return code;
  if (const int code = evaluation.measureFlights(); code != kSuccess) return code;
  return evaluation.report();
}

}  // namespace ridgecast::evaluation
