#include "client/evaluation/plan.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "common/settings/settings.h"

namespace ridgecast::evaluation {
namespace {

constexpr double kFinest = 0.3;            // threshold of `area` at which the budget is what counts
constexpr double kWholePath = 1e9;         // seconds
constexpr double kThesisPath = 20;         // seconds that the thesis's own paths last
constexpr double kPictures = 2.5;          // seconds from one to the next: 125 m at 50 m/s, each shows new ground
constexpr double kIterationsASecond = 10;  // fly.h

// Pairs with nearly the same number of triangles; the server's own setting first.
const std::vector<MeshCase> kFlown = {{"pixels", 1},    {"pixels", 0.5},  {"pixels", 2},    {"thesis", 2e-5},
                                      {"thesis", 1e-5}, {"thesis", 4e-5}, {"area", kFinest}};

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ",") + name;
  return out;
}

Run runOf(const std::string& terrain, const MeshCase& mesh, unsigned threads, int repeat, const std::string& more = {}) {
  std::string name = terrain;
  name.append("-").append(mesh.metric).append(cell("-%g", mesh.threshold));
  if (threads) name.append(cell("-%.0fthreads", threads));
  name.append(more).append(cell("-r%.0f", repeat));
  return {name, terrain, mesh.metric, mesh.threshold, threads, repeat, {}};
}

// Seconds that an iteration, a mesh's picture with its comparisons and a ray march of 1280 x 720 take on two cores and Mesa's driver.
double iterationCost(const MeshCase& mesh) { return mesh.metric == "pixels" ? 0.1 : 0.25; }
constexpr double kPictureCost = 2.5, kMarchCost = 4, kStartCost = 5, kSettleCost = 10;

class Planner {
 public:
  Planner(const EvaluateOptions& options, unsigned cores) : options_(options), cores_(cores) {}

  Plan plan() {
    const EvaluateOptions& o = options_;
    plan_.quick = o.quick;
    plan_.width = o.width.value_or(o.quick ? 480 : 1280);
    plan_.height = o.height.value_or(o.quick ? 270 : 720);
    plan_.repeats = o.repeats.value_or(o.quick ? 1 : 3);
    plan_.framesEvery = o.quick ? 1.5 : kPictures;
    const std::uint32_t most = o.supersample.value_or(o.quick ? 2 : 4);
    for (std::uint32_t n = 1; n <= most; n *= 2) plan_.samples.push_back(n);
    terrains_ = o.terrains.empty() ? std::vector<std::string>{"alpine", "canyon", "archipelago"} : o.terrains;
    cameras_ = o.views.empty() ? std::vector<std::string>{"low", "overview", "grazing"} : o.views;
    scale_ = plan_.width * plan_.height / (1280.0 * 720.0);
    plan_.words = words();
    if (o.only != "flights") addViews();
    if (o.only != "views")
      for (const std::string& terrain : terrains_) addFlights(terrain);
    return std::move(plan_);
  }

 private:
  void addViews() {
    // At the server's own setting, at half of it, and with as many triangles as the budget has; more than 2 x 2 samples of that one alone.
    plan_.meshes = !options_.refined.empty() ? options_.refined
                   : options_.quick          ? std::vector<MeshCase>{{"pixels", 1}, {"area", kFinest}}
                                             : std::vector<MeshCase>{{"pixels", 1}, {"pixels", 0.5}, {"area", kFinest}};
    if (options_.refined.empty())
      for (MeshCase& mesh : plan_.meshes)
        if (mesh.metric != "area") mesh.mostSamples = 2;
    double marches = 2;  // the finer one
    for (const std::uint32_t n : plan_.samples) marches += n * n;
    const double cost = scale_ * (kMarchCost * (marches + plan_.repeats) + 12.0 * static_cast<double>(plan_.meshes.size()));
    for (const ViewCase& view : viewCases())
      if (std::ranges::count(terrains_, view.terrain) && std::ranges::count(cameras_, view.name))
        plan_.views.push_back({view, options_.out / "views" / (std::string(view.terrain) + "-" + std::string(view.name)), cost});
  }

  void add(Run run, double seconds, bool pictures, bool frames = false, bool popping = false) {
    run.folder = options_.out / "flights" / run.name;
    const MeshCase mesh{run.metric, run.threshold};
    const double flown = std::min(seconds, 40.0);
    const double drawn = pictures ? flown / plan_.framesEvery + 1 : 0;
    plan_.flights.push_back({std::move(run), seconds, pictures, frames, popping,
                             kStartCost + kSettleCost + flown * kIterationsASecond * (iterationCost(mesh) + (frames ? 0.03 : 0)) +
                                 drawn * kPictureCost * scale_ + (popping ? 60 * std::min(scale_ * 4, 1.0) : 0)});
  }

  void addFlights(const std::string& terrain) {
    const bool first = terrain == terrains_.front();
    std::vector<MeshCase> flown = options_.refined.empty() ? kFlown : options_.refined;
    if (options_.quick && options_.refined.empty()) {
      flown = {{"pixels", 1}, {"area", kFinest}};
      if (first) flown.insert(flown.begin() + 1, {"thesis", 2e-5});
    }
    const double seconds = options_.seconds.value_or(options_.quick ? 3 : kThesisPath);
    const MeshCase& own = flown.front();
    for (const MeshCase& mesh : flown) {
      const bool whole = !options_.quick && !options_.seconds && mesh.metric == "area";
      add(runOf(terrain, mesh, 0, 1), whole ? kWholePath : seconds, true);
      // The first pays for what the others find there: the ray marches.
      if (&mesh == &flown.front()) plan_.flights.back().cost += (seconds / plan_.framesEvery) * kMarchCost * scale_;
    }
    for (int r = 2; r <= plan_.repeats; ++r) add(runOf(terrain, own, 0, r), seconds, false);
    if (first)
      for (unsigned threads = 1; threads < cores_; threads *= 2)
        for (int r = 1; r <= plan_.repeats; ++r) add(runOf(terrain, own, threads, r), seconds, false);
    if (options_.quick && !first) return;
    add(runOf(terrain, own, 0, 1, "-frames"), seconds, false, true);
    add(runOf(terrain, own, 0, 1, "-standing"), 0, false, false, true);
  }

  std::string words() const {
    std::string out = std::string("evaluate") + (options_.quick ? " --quick" : "") + " --terrains " + joined(terrains_) + " --views " +
                      joined(cameras_) + (options_.only.empty() ? "" : " --only " + options_.only);
    std::vector<std::string> refined;
    for (const MeshCase& mesh : options_.refined) refined.push_back(mesh.metric + ":" + cell("%g", mesh.threshold));
    if (!refined.empty()) out += " --refined " + joined(refined);
    out += " --size " + std::to_string(plan_.width) + "x" + std::to_string(plan_.height) + " --supersample " +
           std::to_string(plan_.samples.back()) + " --repeats " + std::to_string(plan_.repeats);
    if (options_.seconds) out += " --seconds " + cell("%g", *options_.seconds);
    return out;
  }

  const EvaluateOptions& options_;
  unsigned cores_;
  std::vector<std::string> terrains_, cameras_;
  double scale_ = 1;  // of the picture, against 1280 x 720
  Plan plan_;
};

}  // namespace

Outcome<MeshCase> meshCaseFrom(std::string_view text) {
  const std::size_t colon = text.find(':');
  const std::string metric(text.substr(0, colon)), number(colon == std::string_view::npos ? "" : text.substr(colon + 1));
  char* end = nullptr;
  const double threshold = std::strtod(number.c_str(), &end);
  if (metric == "default" || !settings::metricNamed(metric) || number.empty() || *end || !(threshold > 0 && threshold <= 1e6))
    return Error{std::string("'").append(text).append(
        "' is not METRIC:THRESHOLD: pixels, area or thesis, a colon and a number above 0, as in area:0.3")};
  return MeshCase{metric, threshold};
}

Plan planOf(const EvaluateOptions& options, unsigned cores) { return Planner(options, cores).plan(); }

}  // namespace ridgecast::evaluation
