// Whole iterations, without encoding: a moving camera at a fine setting (or --threshold PIXELS, --budget TRIANGLES), a hovering one, and
// two threads against one.
#include <algorithm>
#include <cstdio>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/pipeline/pipeline.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"
#include "tests/support/flight.h"

namespace ridgecast::bench {
namespace {

void add(settings::IterationStats& sum, const settings::IterationStats& figures) {
  sum.inserted += figures.inserted;
  sum.removed += figures.removed;
  sum.heights += figures.heights;
  sum.selectMs += figures.selectMs;
  sum.generateMs += figures.generateMs;
  sum.refineMs += figures.refineMs;
  sum.triangulateMs += figures.triangulateMs;
}

struct Rig {
  Rig(unsigned threads, double threshold, std::uint32_t budget = 2'000'000)
      : executor(threads), terrain(terrain::create("alpine", 1).value()), pool(executor.makePool(threads)) {
    settings::Settings asked;
    asked.threshold = threshold;
    asked.triangleBudget = budget;
    pipeline = std::make_unique<pipeline::Pipeline>(terrain, pipeline::grant(asked, {}), pool);
  }
  // Ten iterations from time `t` of the flight on, `perIteration` seconds apart. Runs as the server does, as a task of the camera's pool,
  // so that two threads are two.
  settings::IterationStats fly(double t, double perIteration) {
    std::promise<settings::IterationStats> done;
    pool->post([&] {
      settings::IterationStats sum{};
      for (int m = 1; m <= 10; ++m) add(sum, pipeline->iterate(testing_support::straight(*terrain, t + m * perIteration)));
      done.set_value(sum);
    });
    return done.get_future().get();
  }
  std::vector<std::uint64_t> hashes() const {
    std::vector<std::uint64_t> out;
    for (const auto& leaf : pipeline->leaves()) out.push_back(leaf.hash);
    return out;
  }
  std::uint64_t settle(double t) {  // vertices inserted
    std::uint64_t inserted = 0;
    for (int n = 0; n < 300 && !pipeline->settled(); ++n) inserted += pipeline->iterate(testing_support::straight(*terrain, t)).inserted;
    return inserted;
  }
  scheduling::Executor executor;
  std::shared_ptr<const terrain::Terrain> terrain;
  std::shared_ptr<scheduling::Pool> pool;
  std::unique_ptr<pipeline::Pipeline> pipeline;
};

constexpr double kFine = 0.25;  // pixels: about a million triangles

}  // namespace

Report iteration(const Options& options) {
  double threshold = kFine, budget = 2e6;
  for (std::size_t k = 0; k + 1 < options.arguments.size(); k += 2) {
    const std::string& name = options.arguments[k];
    if (name != "--threshold" && name != "--budget")
      throw std::runtime_error("iteration takes --threshold PIXELS and --budget TRIANGLES, not " + name);
    (name == "--budget" ? budget : threshold) = std::stod(options.arguments[k + 1]);
  }
  Report report;
  Rig rig(1, threshold, static_cast<std::uint32_t>(budget));
  const double before = cpuSeconds();
  const std::uint64_t made = rig.settle(0);
  const double making = cpuSeconds() - before;
  const int iterations = options.quick ? 100 : 600;
  settings::IterationStats sum{}, last{};
  const double start = cpuSeconds();
  for (int n = 1; n <= iterations; ++n) {
    last = rig.pipeline->iterate(testing_support::straight(*rig.terrain, n * 0.1));
    add(sum, last);
  }
  const double moving = cpuSeconds() - start;
  rig.settle(iterations * 0.1);
  const double hoverStart = cpuSeconds();
  const int hovers = 100;
  for (int n = 0; n < hovers; ++n) rig.pipeline->iterate(testing_support::straight(*rig.terrain, iterations * 0.1));
  const double hover = cpuSeconds() - hoverStart;

  report.note("alpine, 50 m/s at 10 iterations a second, threshold " + std::to_string(threshold) +
              " px, 1280x720, one thread; processor time");
  report.add("us_per_inserted_vertex", 1e6 * moving / static_cast<double>(sum.inserted), "us, everything but encoding");
  report.add("us_per_vertex_at_first", 1e6 * making / static_cast<double>(made), "us, while the mesh is made from nothing");
  report.add("iteration_ms", 1e3 * moving / iterations, "ms");
  report.add("hover_ms", 1e3 * hover / hovers, "ms an iteration with nothing to do");
  report.add("inserted_per_iteration", static_cast<double>(sum.inserted) / iterations, "vertices");
  report.add("removed_per_inserted", static_cast<double>(sum.removed) / static_cast<double>(sum.inserted), "");
  report.add("heights_per_vertex", static_cast<double>(sum.heights) / static_cast<double>(sum.inserted),
             "evaluated for each vertex inserted");
  report.add("triangles", last.triangles, "live at the end");
  report.add("select_ms", sum.selectMs / iterations, "ms, by the clock");
  report.add("generate_ms", sum.generateMs / iterations, "ms");
  report.add("refine_ms", sum.refineMs / iterations, "ms");
  report.add("triangulate_ms", sum.triangulateMs / iterations, "ms");
  return report;
}

Report threads(const Options& options) {
  Report report;
  const int iterations = options.quick ? 60 : 300;
  Rig one(1, kFine), two(2, kFine);
  one.settle(0);
  two.settle(0);
  double seconds[2] = {0, 0};
  settings::IterationStats stages[2]{};
  bool equal = true;
  // In turn, ten iterations each, so that what else the machine does falls on both.
  for (int n = 0; n < iterations; n += 10)
    for (int k = 0; k < 2; ++k) {
      Rig& rig = k == 0 ? one : two;
      const Clock clock;
      add(stages[k], rig.fly(n * 0.2, 0.2));
      seconds[k] += clock.seconds();
      equal = equal && (k == 0 || one.hashes() == two.hashes());
    }
  report.note("alpine, 100 m/s at 10 iterations a second, threshold 0.25 px; by the clock, in turn");
  report.add("speedup_2", seconds[0] / seconds[1], "times the iterations a second of one thread");
  report.add("one_ms", 1e3 * seconds[0] / iterations, "ms an iteration");
  report.add("meshes_equal", equal, "1: all leaves' hashes were, after every ten iterations");
  report.add("two_ms", 1e3 * seconds[1] / iterations, "ms an iteration");
  report.add("select_speedup", stages[0].selectMs / stages[1].selectMs, "of this stage, one thread anyway");
  report.add("generate_speedup", stages[0].generateMs / stages[1].generateMs, "");
  report.add("refine_speedup", stages[0].refineMs / stages[1].refineMs, "");
  report.add("triangulate_speedup", stages[0].triangulateMs / stages[1].triangulateMs, "");
  report.add("generate_share", stages[0].generateMs / (1e3 * seconds[0]), "of one thread's time");
  report.add("refine_share", stages[0].refineMs / (1e3 * seconds[0]), "");
  report.add("triangulate_share", stages[0].triangulateMs / (1e3 * seconds[0]), "");
  return report;
}

}  // namespace ridgecast::bench
