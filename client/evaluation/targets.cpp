#include "client/evaluation/targets.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "client/evaluation/view_numbers.h"

namespace ridgecast::evaluation {
namespace {

using Json = nlohmann::json;

constexpr double kMostTriangles = 500'000;
constexpr double kLike = 0.97, kLikeWhereSteep = 0.95, kLikeUnfiltered = 0.95, kLikeFlying = 0.92;
constexpr double kFaster = 8, kLikeWhenFaster = 0.95;  // on a software driver
constexpr double kPopping = 1.0 / 3;

// The worst of several results, and where it was.
struct Worst {
  bool least;  // is the worst
  double value = kNothing;
  std::string where;
  void add(double v, const std::string& at) {
    if (std::isnan(v) || (!std::isnan(value) && (least ? v >= value : v <= value))) return;
    value = v;
    where = at;
  }
};

void addRow(Table& table, const std::string& what, const char* format, double required, const Worst& worst) {
  if (std::isnan(worst.value)) return;
  const bool met = worst.least ? worst.value >= required : worst.value <= required;
  table.rows.push_back({what, (worst.least ? "at least " : "at most ") + cell(format, required), cell(format, worst.value), worst.where,
                        met ? "yes" : "no"});
}

// The mesh with the most triangles up to kMostTriangles; null: none.
const Json* finestOf(const Json& view) {
  const Json* out = nullptr;
  for (const Json& mesh : view.at("meshes"))
    if (number(mesh, "triangles") <= kMostTriangles && (!out || number(mesh, "triangles") > number(*out, "triangles"))) out = &mesh;
  return out;
}

std::vector<std::string> terrainsOf(const std::vector<Json>& views, const std::vector<FlightResults>& flights) {
  std::vector<std::string> out;
  const auto add = [&out](const std::string& name) {
    if (!std::ranges::count(out, name)) out.push_back(name);
  };
  for (const Json& view : views) add(view.at("terrain").get<std::string>());
  for (const FlightResults& f : flights) add(f.run.terrain);
  return out;
}

void addStanding(Table& table, const std::vector<Json>& views, const std::string& terrain, int samples, bool filtered, double required,
                 const std::string& what) {
  for (const auto& [key, words] : {std::pair("ssim", ""), std::pair("terrain", ", terrain alone")}) {
    Worst worst{true, kNothing, {}};
    for (const Json& view : views)
      if (view.at("terrain") == terrain)
        if (const Json* mesh = finestOf(view))
          worst.add(ssim(pictureOf(*mesh, samples, filtered), "mesh", key), view.at("view").get<std::string>());
    addRow(table, std::string(terrain).append(", ").append(what).append(words), "%.3f", required, worst);
  }
}

void addSpeed(Table& table, const std::vector<Json>& views) {
  Worst faster{true, kNothing, {}}, byCpu = faster;
  for (const Json& view : views) {
    const double march = median(marches(view, "march_ms")), marchCpu = median(marches(view, "march_cpu_ms"));
    for (const Json& mesh : view.at("meshes")) {
      if (ssim(pictureOf(mesh, 1, true), "mesh", "ssim") < kLikeWhenFaster) continue;
      const std::string where = view.at("terrain").get<std::string>() + " " + view.at("view").get<std::string>();
      faster.add(march / median(numbers(mesh.at("times"), "mesh_ms")), where);
      byCpu.add(marchCpu / median(numbers(mesh.at("times"), "mesh_cpu_ms")), where);
    }
  }
  addRow(table, "a picture of the mesh, faster than ray marching where SSIM is at least 0.95", "%.1f", kFaster, faster);
  addRow(table, "the same, by CPU time", "%.1f", kFaster, byCpu);
}

}  // namespace

Table targetsOf(const std::vector<Json>& views, const std::vector<FlightResults>& flights) {
  Table out{
      "targets",
      "Required and measured",
      "The worst case of each. Cameras at rest: the settled mesh with the most triangles up to 500,000. Flights: refined by area. Speed is "
      "required on Mesa's software driver.",
      {"what", "required", "measured", "where", "met"},
      {}};
  for (const std::string& terrain : terrainsOf(views, flights))
    addStanding(out, views, terrain, 4, true, terrain == "canyon" ? kLikeWhereSteep : kLike, "camera at rest, filtered, 2x2 samples");
  for (const std::string& terrain : terrainsOf(views, flights))
    addStanding(out, views, terrain, 16, false, kLikeUnfiltered, "camera at rest, unfiltered, 4x4 samples");
  Worst popping{false, kNothing, {}}, differing = popping;
  for (const auto& [run, summary, iterations, others] : flights) {
    if (run.metric == "area")
      for (const auto& [reached, words] : {std::pair(summary.mean.ssim, ""), std::pair(summary.mean.terrain, ", terrain alone")}) {
        Worst flown{true, kNothing, {}};
        flown.add(reached, "mean of " + std::to_string(summary.frames.count) + " pictures");
        addRow(out, std::string(run.terrain).append(", along the flight at 50 m/s").append(words), "%.3f", kLikeFlying, flown);
      }
    popping.add(summary.popping.on / summary.popping.off, run.terrain);
    differing.add(static_cast<double>(summary.hashMismatches), run.name);
  }
  addSpeed(out, views);
  addRow(out, "largest change between frames while a mesh refines, with morphing as a share of without", "%.3f", kPopping, popping);
  if (differing.value == 0) differing.where = "all flights";
  addRow(out, "iterations after which a client's mesh differed from the server's", "%.0f", 0, differing);
  return out;
}

}  // namespace ridgecast::evaluation
