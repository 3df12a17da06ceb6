// The error on screen at rest against what was asked for, and what the thesis's metric needs for the same picture.
#include <algorithm>
#include <cmath>

#include "tests/bench/bench.h"
#include "tests/bench/edited_views.h"
#include "tests/bench/pictures.h"
#include "tests/bench/random_poses.h"
#include "tests/support/flight.h"
#include "tests/support/rays.h"

namespace ridgecast::bench {
namespace {

// Thresholds that give about 50,000 to 400,000 triangles here.
struct Series {
  const char* name;
  settings::Metric metric;
  std::vector<double> thresholds;
};
const std::vector<Series>& series() {
  static const std::vector<Series> all = {{"pixels", settings::Metric::kPixels, {1.4, 1.0, 0.7, 0.5}},
                                          {"area", settings::Metric::kArea, {3.5, 2.4, 1.6, 1.0}},
                                          {"thesis", settings::Metric::kThesis, {1e-4, 5e-5, 2.5e-5, 1.2e-5, 6e-6}}};
  return all;
}

// Errors in pixels at the hits, of a mesh refined till it settles.
struct Settled {
  std::vector<double> pixels;
  std::vector<double> distance;
  std::uint32_t triangles;
  double heightsPerVertex;
};
Settled settle(const std::shared_ptr<const terrain::Terrain>& terrain, const camera::Camera& camera,
               const std::vector<testing_support::Hit>& hits, settings::Metric metric, double threshold) {
  scheduling::Executor executor(2);
  settings::Settings asked;
  asked.metric = metric;
  asked.threshold = threshold;
  asked.triangleBudget = 2'000'000;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), executor.makePool(2));
  Settled out{};
  std::uint64_t heights = 0, inserted = 0;
  for (int n = 0; n < 300 && !pipeline.settled(); ++n) {
    const auto figures = pipeline.iterate(camera);
    out.triangles = figures.triangles;
    if (n == 0) continue;  // the grids
    heights += figures.heights;
    inserted += figures.inserted;
  }
  out.heightsPerVertex = static_cast<double>(heights) / static_cast<double>(inserted);
  const auto held = testing_support::HeldMesh(pipeline).at(hits);
  for (std::size_t k = 0; k < hits.size(); ++k) {
    if (!(held[k].y == held[k].y)) continue;
    out.pixels.push_back(std::abs(held[k].y - hits[k].y) * hits[k].pixels);
    out.distance.push_back(hits[k].distance);
  }
  return out;
}

double mean(const std::vector<double>& v) {
  double sum = 0;
  for (double x : v) sum += x;
  return sum / static_cast<double>(v.size());
}

struct Row {
  double threshold, triangles, ssim;
};

// Triangles of a series at an SSIM, between its rows on a logarithmic scale; NaN beyond them.
double trianglesAt(const std::vector<Row>& rows, double ssim) {
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const Row &a = rows[k - 1], &b = rows[k];
    if (!(a.ssim <= ssim && ssim <= b.ssim)) continue;
    const double t = b.ssim > a.ssim ? (ssim - a.ssim) / (b.ssim - a.ssim) : 0;
    return std::exp(std::log(a.triangles) * (1 - t) + std::log(b.triangles) * t);
  }
  return NAN;
}

}  // namespace

Report error(const Options& options) {
  if (options.arguments == std::vector<std::string>{"--edits"}) return errorOfEditedViews(options);
  if (!options.arguments.empty()) return errorOfRandomPoses(options);
  const auto terrain = terrain::create("alpine", 1).value();
  const auto camera = testing_support::straight(*terrain, 0);
  const auto hits = testing_support::castRays(*terrain, camera, options.quick ? 160 : 480);
  const Settled ours = settle(terrain, camera, hits, settings::Metric::kPixels, 1.0);
  std::vector<double> near, far;
  for (std::size_t k = 0; k < ours.pixels.size(); ++k) (ours.distance[k] < 1000 ? near : far).push_back(ours.pixels[k]);
  Report report;
  report.note("alpine at rest, 120 m above the ground, 1280x720, " + std::to_string(ours.pixels.size()) +
              " rays that meet the ground within 20 km");
  report.add("p99_px", percentile(ours.pixels, 0.99), "px, threshold 1");
  report.add("p99_near_px", percentile(near, 0.99), "px, within 1 km");
  report.add("p99_far_px", percentile(far, 0.99), "px, beyond");
  report.add("median_px", percentile(ours.pixels, 0.5), "px");
  report.add("mean_px", mean(ours.pixels), "px");
  report.add("max_px", percentile(ours.pixels, 1), "px");
  report.add("triangles", ours.triangles);
  report.add("heights_per_vertex", ours.heightsPerVertex, "evaluated for each vertex inserted");

  // The same SSIM, by the client's own pictures: the mesh drawn against the converged ray march.
  double ratio = NAN, ratioPixels = NAN;
  if (!options.quick) {
    Pictures pictures(options.programFolder, "alpine", camera);
    std::vector<Row> rows[3];
    report.note("| metric | threshold | triangles | mean px | median px | p99 px | SSIM | of terrain alone |");
    report.note("|---|---|---|---|---|---|---|---|");
    for (std::size_t k = 0; k < series().size(); ++k)
      for (const double threshold : series()[k].thresholds) {
        const Settled settled = settle(terrain, camera, hits, series()[k].metric, threshold);
        const auto similarity = pictures.settled(series()[k].name, threshold);
        rows[k].push_back({threshold, static_cast<double>(settled.triangles), similarity.all});
        char line[200];
        std::snprintf(line, sizeof line, "| %s | %g | %u | %.3f | %.3f | %.3f | %.4f | %.4f |", series()[k].name, threshold,
                      settled.triangles, mean(settled.pixels), percentile(settled.pixels, 0.5), percentile(settled.pixels, 0.99),
                      similarity.all, similarity.terrain);
        report.note(line);
        progress(line);
      }
    const auto compare = [&](const std::vector<Row>& mine) {
      std::vector<double> ratios;
      for (const Row& r : mine)
        if (const double theirs = trianglesAt(rows[2], r.ssim); theirs == theirs) ratios.push_back(r.triangles / theirs);
      return ratios.empty() ? NAN : median(ratios);
    };
    ratioPixels = compare(rows[0]);
    ratio = compare(rows[1]);
  }
  report.add("triangles_vs_thesis_metric", ratio,
             "of the thesis's triangles at the same SSIM, metric area; the median over its thresholds");
  report.add("triangles_vs_thesis_metric_pixels", ratioPixels, "the same, metric pixels");
  return report;
}

}  // namespace ridgecast::bench
