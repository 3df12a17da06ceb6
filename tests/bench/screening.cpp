// A pass over all candidates against merely reading the arrays it reads.
#include <algorithm>
#include <memory>
#include <numeric>

#include "server/generation/camera_mesh.h"
#include "server/pipeline/pipeline.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"
#include "tests/support/flight.h"

namespace ridgecast::bench {

Report screening(const Options& options) {
  const auto terrain = terrain::create("alpine", 1).value();
  scheduling::Executor executor(1);
  auto pool = executor.makePool(1);
  generation::CameraMesh mesh(terrain, 1'200'000, refinement::Metric::kPixels);
  const auto camera = testing_support::straight(*terrain, 0);
  refinement::AdaptiveMesh& m = mesh.mesh();
  const auto evaluate = [&] { mesh.forEachChanged([&](std::size_t k) { m.evaluateFresh(mesh.leaves()[k]->region, nullptr); }); };
  mesh.select(camera.pose, terrain->height({camera.pose.x, camera.pose.z}));
  mesh.generate(*pool);
  evaluate();
  const auto find = [&](const refinement::View& view, double threshold) {
    std::vector<refinement::AdaptiveMesh::Search> searches;
    for (generation::Leaf* leaf : mesh.leaves()) searches.push_back({leaf->region, true, 0, &leaf->work});
    for (std::size_t k = 0; k < searches.size(); k += 16)
      m.findWork(std::span(searches).subspan(k, std::min<std::size_t>(16, searches.size() - k)), view, threshold);
  };
  // Refine everywhere in view until there are half a million triangles.
  double threshold = 4;
  double travel = 0;
  for (int n = 0; n < 200 && m.triangulation().liveTriangles() < (options.quick ? 100'000u : 500'000u); ++n, threshold *= 0.93) {
    const refinement::View view(camera, m.anchor(), travel += 1e12, 0, false);
    triangulation::WriteSet all;
    all.allowAll();
    find(view, threshold);
    for (generation::Leaf* leaf : mesh.leaves()) {
      m.insertWanted(leaf->region, view, all, leaf->work);
      leaf->work.end();
    }
    evaluate();
  }
  const auto& pages = m.triangulation().trianglePages();
  const double live = m.triangulation().liveTriangles();
  std::vector<double> read, screen;
  std::uint32_t sum[16]{};
  for (int round = 0; round < 31; ++round) {
    double start = cpuSeconds();
    for (const generation::Leaf* leaf : mesh.leaves())
      for (std::uint32_t page : pages.pagesOf(leaf->region)) {
        // The page's own record and mask are read by the pass, too.
        const refinement::PageScreen& known = m.screen(page);
        sum[0] += static_cast<std::uint32_t>(known.dormant + known.blank + pages.aliveMask(page));
        for (const refinement::Candidates* block : m.candidatesOf(page))
          for (std::size_t line = 0; block && line < triangulation::TrianglePages::kBlock / refinement::Candidates::kSlots; ++line) {
            const auto& words = reinterpret_cast<const std::uint32_t(&)[16]>(block[line]);
            for (std::size_t k = 0; k < 16; ++k) sum[k] += words[k];
          }
      }
    read.push_back(cpuSeconds() - start);
    // A camera far travelled: nothing is skipped, every page is looked at. The threshold is above all errors: nothing is to be done.
    const refinement::View view(camera, m.anchor(), travel += 1e12, 0, false);
    start = cpuSeconds();
    find(view, 50);
    screen.push_back(cpuSeconds() - start);
  }
  // The product's own idle iteration, of as many triangles.
  settings::Settings asked;
  asked.threshold = options.quick ? 1.0 : 0.4;
  asked.triangleBudget = 2'000'000;
  pipeline::Pipeline idle(terrain, pipeline::grant(asked, {}), pool);
  settings::IterationStats last{};
  for (int n = 0; n < 300 && !idle.settled(); ++n) last = idle.iterate(camera);
  const double start = cpuSeconds();
  for (int n = 0; n < 50; ++n) last = idle.iterate(camera);
  const double idleMs = 1e3 * (cpuSeconds() - start) / 50;

  Report report;
  report.note(std::to_string(m.triangulation().liveTriangles()) + " triangles; one thread, processor time" +
              (std::accumulate(sum, sum + 16, 0u) == 1 ? " " : ""));
  report.add("ratio_to_read", median(screen) / median(read), "of reading the arrays once");
  report.add("read_ns", 1e9 * median(read) / live, "ns a triangle");
  report.add("screen_ns", 1e9 * median(screen) / live, "ns a triangle");
  report.add("idle_iteration_ms", idleMs, "ms");
  report.add("idle_triangles", last.triangles, "live in the idle iteration");
  return report;
}

}  // namespace ridgecast::bench
