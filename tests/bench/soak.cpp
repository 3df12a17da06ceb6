// An hour's flight in one camera's mesh, without a network: 36,000 iterations with a budget, checked as it goes.
//   --export DIR   writes 20 exports of the mesh as .glb files
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>
#include <vector>

#include "client/evaluation/recorder.h"
#include "server/pipeline/pipeline.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"
#include "tests/support/flight.h"
#include "tests/support/mesh_check.h"
#include "tests/support/verify.h"

namespace ridgecast::bench {

namespace {

// Which points come to the mesh that were gone for at most 20 iterations, in leaves that stay. A point belongs to all leaves whose
// triangles it is a corner of.
class Returns {
 public:
  void look(const pipeline::Pipeline& pipeline, int iteration) {
    std::map<lattice::LeafAddress, Held> now;
    std::vector<std::pair<lattice::Point, int>> changes;  // and by how much the number of leaves that have it changes
    for (const mesh::LeafState& leaf : pipeline.leaves()) {
      const auto before = held_.find(leaf.address);
      if (before != held_.end() && before->second.version == leaf.version) {
        now.insert(held_.extract(before));
        continue;
      }
      Held held{leaf.version, {}};
      for (const mesh::LocalVertex& v : pipeline.extract(leaf.address).vertices)
        held.points.push_back({leaf.address.x() + v.x, leaf.address.z() + v.z});
      for (const lattice::Point& p : held.points) changes.emplace_back(p, 1);
      now.emplace(leaf.address, std::move(held));
    }
    bool otherLeaves = false;
    for (const auto& [address, held] : held_) {  // changed or gone
      otherLeaves = otherLeaves || !now.contains(address);
      for (const lattice::Point& p : held.points) changes.emplace_back(p, -1);
    }
    held_ = std::move(now);
    for (const auto& [point, by] : changes) before_.emplace(point, leaves_[point]);
    for (const auto& [point, by] : changes) leaves_[point] += by;
    for (const auto& [point, count] : before_) {
      const bool is = leaves_[point] > 0;
      if (!is) leaves_.erase(point);
      if (otherLeaves || is == (count > 0)) continue;
      if (!is) gone_[point] = iteration;
      if (const auto it = gone_.find(point); is && it != gone_.end()) count_ += iteration - it->second <= 20;
    }
    before_.clear();
    if (iteration % 50 == 0) std::erase_if(gone_, [&](const auto& entry) { return iteration - entry.second > 20; });
  }
  std::uint64_t count() const { return count_; }

 private:
  struct Held {
    std::uint64_t version;
    std::vector<lattice::Point> points;
  };
  std::map<lattice::LeafAddress, Held> held_;
  std::map<lattice::Point, int> leaves_, before_, gone_;  // gone_: in which iteration
  std::uint64_t count_ = 0;
};

}  // namespace

Report soak(const Options& options) {
  std::string folder;
  for (std::size_t k = 0; k + 1 < options.arguments.size(); ++k)
    if (options.arguments[k] == "--export") folder = options.arguments[k + 1];
  if (!folder.empty()) std::filesystem::create_directories(folder);

  const int iterations = options.quick ? 1200 : 36'000, speed = options.quick ? 30 : 1;  // a quick one flies the hour in leaps
  constexpr std::uint32_t kBudget = 300'000;
  scheduling::Executor executor(2);
  const auto terrain = terrain::create("alpine", 1).value();
  settings::Settings asked;
  asked.threshold = 0.5;
  asked.triangleBudget = kBudget;
  pipeline::Pipeline pipeline(terrain, pipeline::grant(asked, {}), executor.makePool(2));

  std::uint32_t most = 0, checks = 0, failures = 0, exports = 0, longestHover = 0, hoverChanging = 0;
  std::uint64_t inserted = 0, removed = 0;
  double residentMiddle = 0, residentMost = 0;
  std::string firstFailure;
  double bytesPerTriangle = 0;
  const double start = cpuSeconds();
  bool hovering = false;
  Returns returns;
  for (int n = 0; n < iterations; ++n) {
    const double t = 0.1 * n * speed;
    const auto figures = pipeline.iterate(testing_support::hour(*terrain, t));
    most = std::max(most, figures.triangles);
    if (figures.triangles > kBudget / 2)
      bytesPerTriangle = std::max(bytesPerTriangle, static_cast<double>(pipeline.memoryBytes()) / figures.triangles);
    returns.look(pipeline, n);
    inserted += figures.inserted;
    removed += figures.removed;
    const bool hover = std::fmod(t, 600) >= 200 && std::fmod(t, 600) < 300;
    if (hover && !hovering) hoverChanging = 0;
    if (hover && !pipeline.settled()) longestHover = std::max(longestHover, ++hoverChanging);
    hovering = hover;
    if (n % 100 == 99) {
      ++checks;
      if (const std::string wrong = testing_support::verify(pipeline.mesh()); !wrong.empty()) {
        ++failures;
        if (firstFailure.empty()) firstFailure = "iteration " + std::to_string(n) + ": " + wrong;
      }
      const double resident = residentBytes();
      if (n >= iterations / 2) {
        if (residentMiddle == 0) residentMiddle = resident;
        residentMost = std::max(residentMost, resident);
      }
    }
    if ((n + 1) % (iterations / 20) == 0) {
      std::vector<mesh::LeafMesh> all;
      for (const auto& l : pipeline.leaves()) all.push_back(pipeline.extract(l.address));
      const auto report = testing_support::checkMesh(all);
      if (!report.clean()) {
        ++failures;
        if (firstFailure.empty()) firstFailure = "iteration " + std::to_string(n) + ": " + report.text();
      }
      if (!folder.empty()) {
        std::map<lattice::LeafAddress, core::HeldLeaf> held;
        for (auto& leaf : all) {
          const auto address = leaf.address;
          held[address].mesh = std::make_shared<const mesh::LeafMesh>(std::move(leaf));
        }
        const auto file = std::filesystem::path(folder) / ("soak-" + std::to_string(n + 1) + ".glb");
        const auto written = evaluation::writeGlb(held, testing_support::hour(*terrain, t).pose, "alpine", 1, file);
        if (!written) throw std::runtime_error(written.error().message);
        ++exports;
      }
      progress(std::to_string(100 * (n + 1) / iterations) + " %: " + std::to_string(figures.triangles) + " triangles, threshold " +
               std::to_string(figures.effectiveThreshold) + " px, " + std::to_string(static_cast<int>(residentBytes() / 1048576)) +
               " MiB, " + std::to_string(pipeline.memoryBytes() / std::max(1u, figures.triangles)) + " bytes a triangle");
    }
  }
  Report report;
  report.note(std::to_string(iterations) + " iterations, budget 300,000 triangles, threshold 0.5 px, two threads");
  if (!firstFailure.empty()) report.note("first failure, " + firstFailure);
  report.add("max_triangles", most);
  report.add("rss_growth_percent", 100 * (residentMost / residentMiddle - 1), "% over the second half");
  report.add("rss_mib", residentMost / 1048576, "MiB");
  report.add("bytes_per_triangle", bytesPerTriangle,
             "bytes, of the camera's mesh in all, the most while the budget is more than half used");
  report.add("checks", checks);
  report.add("failures", failures);
  report.add("exports", exports);
  report.add("inserted", static_cast<double>(inserted));
  report.add("removed", static_cast<double>(removed));
  report.add("again_percent", 100 * static_cast<double>(returns.count()) / static_cast<double>(inserted),
             "% of insertions put back what was removed within 2 s");
  report.add("hover_iterations", longestHover, "until nothing changed, the longest");
  report.add("cpu_s", cpuSeconds() - start, "s");
  return report;
}

}  // namespace ridgecast::bench
