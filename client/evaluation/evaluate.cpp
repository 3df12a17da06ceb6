#include "client/evaluation/evaluate.h"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>
#include <utility>

#include "client/evaluation/embedded.h"
#include "client/evaluation/fly.h"
#include "client/evaluation/others.h"
#include "client/evaluation/own_server.h"
#include "client/evaluation/plan.h"
#include "client/evaluation/text_file.h"
#include "client/evaluation/views.h"
#include "client/exit/exit.h"
#include "common/settings/settings.h"
#include "common/version/version.h"

namespace ridgecast::evaluation {
namespace {

using Clock = std::chrono::steady_clock;

// Triangles. Both have at most 500,000: a view's settled mesh fills 98 % of its budget.
constexpr std::uint32_t kViewBudget = 510'000, kFlightBudget = 500'000;
constexpr std::size_t kMaxReferences = 32;  // of one terrain: more than a flight's pictures

std::string_view pathOf(const std::string& terrain) {
  return terrain == "alpine" ? embedded::alpine : terrain == "canyon" ? embedded::canyon : embedded::archipelago;
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

  // Refuses a folder of other options. Notes the options and the machine in a new one.
  int begin() {
    const std::string& words = plan_.words;
    const std::filesystem::path file = out_ / "options.txt";
    std::string known;
    if (std::ifstream in(file); std::getline(in, known)) {
      std::getline(in, machine_);
      if (known != words)
        return fail(kBadInput, {out_.string() + " holds results of '" + known + "', not of '" + words +
                                "': choose another --out, or the same options"});
      return kSuccess;
    }
    machine_ = "ridgecast-client " + std::string(version::product()) + ", commit " + std::string(version::commit()) + "; " +
               processorName() + ", " + std::to_string(std::thread::hardware_concurrency()) + " threads; " + words;
    return wrote(writeText(file, words + "\n" + machine_ + "\n"));
  }

  int measureViews() {
    for (const PlannedView& planned : plan_.views) {
      const ViewCase& view = planned.view;
      const int meshes = static_cast<int>(plan_.meshes.size());
      ViewMeasurement measurement(view, {plan_.samples, plan_.repeats, (plan_.repeats + meshes - 1) / meshes}, planned.folder);
      const Part part{planned.folder, resultOf(planned), planned.cost, std::string(view.terrain), evaluation::pathOf(view), 0};
      const auto fly = [&](FlyOptions& options) {
        options.out = planned.folder / "mesh";
        for (const MeshCase& mesh : plan_.meshes) {
          options.settings = {settings::metricNamed(mesh.metric).value(), mesh.threshold, kViewBudget};
          options.atRest = [&](const AtRest& at) { return measurement.measure(mesh, at); };
          if (const int code = evaluation::fly(options); code != kSuccess) return code;
        }
        return kSuccess;
      };
      if (const int code = measure(part, fly, [&] { return measurement.finish(); }); code != kSuccess) return code;
    }
    return kSuccess;
  }

  int measureFlights() {
    for (const PlannedFlight& planned : plan_.flights) {
      const Run& run = planned.run;
      if (std::exchange(over_, run.terrain) != run.terrain) references_.clear();
      const Part part{run.folder, resultOf(planned), planned.cost, run.terrain, std::string(pathOf(run.terrain)), run.threads};
      const auto fly = [&](FlyOptions& options) {
        options.settings = {settings::metricNamed(run.metric).value(), run.threshold, kFlightBudget};
        options.corrected = options.unfiltered = options.pictures = planned.pictures;
        options.framesEvery = plan_.framesEvery;
        options.references = &references_;
        options.measurePopping = planned.popping;
        options.measureFrames = planned.frames;
        options.seconds = planned.seconds;
        return evaluation::fly(options);
      };
      if (const int code = measure(part, fly, [] { return Outcome<void>(); }); code != kSuccess) return code;
    }
    return kSuccess;
  }

  // Of the parts that have results: names them in parts.json, and leaves it to report.py.
  int report() {
    nlohmann::json parts{{"flights", nlohmann::json::array()}, {"views", nlohmann::json::array()}};
    const auto nameOf = [this](const std::filesystem::path& folder) { return folder.lexically_relative(out_).string(); };
    for (const PlannedFlight& planned : plan_.flights) {
      const Run& run = planned.run;
      if (std::filesystem::exists(resultOf(planned)))
        parts["flights"].push_back({{"name", run.name},
                                    {"terrain", run.terrain},
                                    {"metric", run.metric},
                                    {"threshold", run.threshold},
                                    {"threads", run.threads},
                                    {"repeat", run.repeat},
                                    {"folder", nameOf(run.folder)}});
    }
    for (const PlannedView& planned : plan_.views)
      if (std::filesystem::exists(resultOf(planned))) parts["views"].push_back(nameOf(planned.folder));
    const std::size_t all = plan_.flights.size() + plan_.views.size(), there = parts["flights"].size() + parts["views"].size();
    if (there == 0) return fail(kBadInput, {"no results yet in " + out_.string()});
    if (there < all) machine_ += "; " + std::to_string(there) + " of its " + std::to_string(all) + " parts";
    parts["machine"] = machine_;
    if (const int code = wrote(writeText(out_ / "parts.json", parts.dump(2) + "\n")); code != kSuccess) return code;
    const std::filesystem::path script = out_ / "report.py";
    if (const int code = wrote(writeText(script, embedded::report)); code != kSuccess) return code;
    if (const int code = run(script); code != kSuccess) return code;
    std::fprintf(stderr, "%s, after %.0f s\n", (out_ / "report.html").c_str(), seconds());
    return kSuccess;
  }

 private:
  double seconds() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }
  // By Debian's Python, which has the packages that apt installs; it says what is wrong.
  static int run(const std::filesystem::path& script) {
    std::string python = "/usr/bin/python3", file = script.string();
    char* arguments[] = {python.data(), file.data(), nullptr};
    pid_t child = 0;
    int status = 0;
    if (posix_spawn(&child, python.c_str(), nullptr, nullptr, arguments, environ) != 0)
      return fail(kRuntimeFailure,
                  {"the results are there, but not their report: install python3-matplotlib, and run it again with --report"});
    return waitpid(child, &status, 0) == child && status == 0 ? kSuccess : kRuntimeFailure;
  }
  static int wrote(const Outcome<void>& written) { return written ? kSuccess : fail(kBadInput, written.error()); }

  // A measurement with its own server and folder.
  struct Part {
    std::filesystem::path folder, result;  // result: exists once the part is complete
    double cost = 0;
    std::string terrain, path;  // path: of the camera, the text of a path file
    unsigned threads = 0;       // of the server
  };

  // Skips a part with a result. `fly` completes the options and flies; `finish` writes the result.
  template <class Fly, class Finish>
  int measure(const Part& part, const Fly& fly, const Finish& finish) {
    const std::string name = part.folder.filename().string();
    const bool there = std::filesystem::exists(part.result);
    ++number_;
    if (there) planned_ += part.cost;
    std::fprintf(stderr, "[%zu of %zu, %.0f s%s] %s%s\n", number_, plan_.views.size() + plan_.flights.size(), seconds(), left().c_str(),
                 name.c_str(), there ? ": already measured" : "");
    if (there) return kSuccess;
    const Others others;
    std::error_code failed;
    std::filesystem::create_directories(part.folder, failed);
    const std::filesystem::path path = part.folder / "path.json";
    if (const int code = wrote(writeText(path, part.path)); code != kSuccess) return code;
    {
      auto own =
          OwnServer::start(server_, {"--terrain", part.terrain, "--seed", "1", "--threads", std::to_string(part.threads)}, part.folder);
      if (!own) return fail(kRuntimeFailure, own.error());
      FlyOptions options;
      options.url.port = std::to_string((*own)->port());
      options.path = path;
      options.out = part.folder;
      options.width = plan_.width;
      options.height = plan_.height;
      options.settleLimit = plan_.quick ? 30 : 120;
      if (const int code = fly(options); code != kSuccess)
        return fail(code, {name + " failed; run the same command again to continue there"});
    }
    const auto share = others.share();
    const std::string machine = "{\"others\": " + (share ? std::to_string(*share) : "null") + "}\n";
    if (const int code = wrote(writeText(part.folder / "machine.json", machine)); code != kSuccess) return code;
    if (auto finished = finish(); !finished) return fail(kRuntimeFailure, finished.error());
    planned_ += part.cost;
    spent_ += part.cost;
    return kSuccess;
  }

  // The time left, at the pace so far.
  std::string left() const {
    if (spent_ <= 0) return {};
    double all = 0;
    for (const PlannedView& v : plan_.views) all += v.cost;
    for (const PlannedFlight& f : plan_.flights) all += f.cost;
    char text[64];
    std::snprintf(text, sizeof text, ", about %.0f min left", std::ceil((all - planned_) * seconds() / spent_ / 60));
    return text;
  }
  static std::filesystem::path resultOf(const PlannedView& planned) { return planned.folder / "view.json"; }
  static std::filesystem::path resultOf(const PlannedFlight& planned) { return planned.run.folder / "machine.json"; }

  std::filesystem::path out_;
  Plan plan_;
  std::filesystem::path server_;
  References references_{kMaxReferences};
  std::string machine_, over_;  // the terrain that was flown over last
  Clock::time_point began_ = Clock::now();
  std::size_t number_ = 0;
  double planned_ = 0, spent_ = 0;  // costs: of all parts with results, of those measured in this run
};

}  // namespace

int evaluate(const EvaluateOptions& options) {
  std::error_code failed;
  std::filesystem::create_directories(options.out, failed);
  if (failed) return fail(kBadInput, {"cannot make the folder " + options.out.string() + ": " + failed.message()});
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
