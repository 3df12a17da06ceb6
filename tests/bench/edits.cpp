// A session's log of edits on this disk: commits a second, and cold starts from the cached ground and from the edits alone.
#include <memory>
#include <random>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "server/edit_log/log.h"
#include "tests/bench/bench.h"
#include "tests/bench/usage.h"
#include "tests/support/process.h"

namespace ridgecast::bench {
namespace {

using edit_log::Edit;
using edit_log::Log;

constexpr lattice::Step kMetre = lattice::kStepsPerMetre;

struct Session {
  std::unique_ptr<Log> log;
  edits::History history;

  void append(std::vector<edits::Operation> operations) {
    const std::shared_ptr<const edits::Layer> before = history.layer();
    std::vector<Edit> edits;
    std::vector<edits::Posts> changed;
    for (edits::Operation& o : operations) {
      changed.push_back(history.add(o).value());
      edits.push_back({history.last(), "", "somebody", 1'700'000'000'000'000, std::move(o)});
    }
    log->append(edits, *before, *history.layer(), changed).value();
  }
};

Session open(const std::filesystem::path& file, const std::shared_ptr<const terrain::Terrain>& terrain) {
  auto log = Log::open(file, {std::string(terrain->name()), terrain->seed(), {}, terrain::contentHash(*terrain)}).value();
  auto history = edit_log::historyOf(*log, terrain, std::size_t{4} << 30).value();
  return {std::move(log), std::move(history)};
}

// 2 m wide, on a square of 1,600 m.
edits::Operation smallEdit(std::mt19937_64& random) {
  const auto place = [&] { return static_cast<lattice::Step>(random() % (1600 * static_cast<std::uint64_t>(kMetre))); };
  const lattice::Step x = place();
  return {edits::Raise{{x, place()}, kMetre, 0, static_cast<std::int32_t>(random() % 512)}, 0};
}

double commits(const std::filesystem::path& file, const std::shared_ptr<const terrain::Terrain>& terrain, std::size_t group, int count) {
  Session session = open(file, terrain);
  std::mt19937_64 random(1);
  const Clock clock;
  for (int k = 0; k < count; ++k) {
    std::vector<edits::Operation> operations;
    for (std::size_t n = 0; n < group; ++n) operations.push_back(smallEdit(random));
    session.append(std::move(operations));
  }
  return count / clock.seconds();
}

// How much longer heights take with edits, in batches as meshes ask for them, whose places lie within 32 m: the median of paired runs.
double slowdown(const terrain::Terrain& plain, const terrain::Terrain& edited, lattice::Point corner, int batches) {
  constexpr std::size_t kBatch = 256;
  std::mt19937_64 random(3);
  std::vector<double> ratios;
  std::vector<lattice::Step> x(kBatch), z(kBatch);
  std::vector<float> out(kBatch);
  for (int run = 0; run < 9; ++run) {
    double seconds[2] = {0, 0};
    for (int batch = 0; batch < batches; ++batch) {
      const auto near = [&](std::uint64_t metres) { return static_cast<lattice::Step>(random() % (metres * kMetre)); };
      const lattice::Point place{corner.x + near(1500), corner.z + near(1500)};
      for (std::size_t k = 0; k < kBatch; ++k) x[k] = place.x + near(32), z[k] = place.z + near(32);
      for (const std::size_t which : {batch % 2, 1 - batch % 2}) {
        const double start = cpuSeconds();
        (which == 1 ? edited : plain).heights(x, z, out);
        seconds[which] += cpuSeconds() - start;
      }
    }
    ratios.push_back(seconds[1] / seconds[0]);
  }
  return median(ratios);
}

}  // namespace

Report edits(const Options& options) {
  const testing_support::ScratchFolder folder;
  const auto terrain = terrain::create("alpine", 1).value();
  Report report;
  for (const std::size_t group : {1, 16})
    report.add("commits_per_second_of_" + std::to_string(group),
               commits(folder / ("commits" + std::to_string(group)), terrain, group, options.quick ? 50 : 500), "1/s");

  const std::size_t count = options.quick ? 20'000 : 1'000'000;
  const auto file = folder / "small";
  {
    Session session = open(file, terrain);
    std::mt19937_64 random(2);
    const double before = cpuSeconds();
    while (session.history.last() < count) {
      std::vector<edits::Operation> operations;
      for (int n = 0; n < 4000; ++n) operations.push_back(smallEdit(random));
      session.append(std::move(operations));
    }
    report.add("small_edits", static_cast<double>(session.history.last()));
    report.add("made_in", cpuSeconds() - before, "s");
  }
  report.add("bytes_an_edit_in_the_file", static_cast<double>(std::filesystem::file_size(file)) / static_cast<double>(count), "B");
  double start = cpuSeconds();
  Session session = open(file, terrain);
  report.add("cold_start", cpuSeconds() - start, "s");
  report.add("tiles", static_cast<double>(session.history.layer()->tiles()));
  report.add("layer", static_cast<double>(session.history.layer()->bytes()) / (1 << 20), "MiB");
  for (const std::string name : {"alpine", "archipelago"}) {
    const auto plain = terrain::create(name, 1).value();
    const edits::EditedTerrain edited(plain, session.history.layer());
    report.add("heights_" + name + "_edited", slowdown(*plain, edited, {0, 0}, options.quick ? 20 : 500), "times");
    report.add("heights_" + name + "_elsewhere", slowdown(*plain, edited, {10'000 * kMetre, 0}, options.quick ? 20 : 500), "times");
  }
  start = cpuSeconds();
  session.history.replay().value();
  report.add("replay", cpuSeconds() - start, "s");

  // Ground as large as a session may have.
  const auto large = folder / "large";
  {
    Session made = open(large, terrain);
    for (int k = 0; k < (options.quick ? 4 : 128); ++k)
      made.append({{edits::Raise{{k % 12 * 600 * kMetre, k / 12 * 600 * kMetre}, 256 * kMetre, 0, 9999}, 1}});
  }
  start = cpuSeconds();
  const Session largest = open(large, terrain);
  report.add("large_cold_start", cpuSeconds() - start, "s");
  report.add("large_tiles", static_cast<double>(largest.history.layer()->tiles()));
  report.add("large_layer", static_cast<double>(largest.history.layer()->bytes()) / (1 << 20), "MiB");
  report.add("large_bytes_a_tile_in_the_file",
             static_cast<double>(std::filesystem::file_size(large)) / static_cast<double>(largest.history.layer()->tiles()), "B");
  report.note("seconds are of the processor; commits are synced to " + std::filesystem::temp_directory_path().string());
  return report;
}

}  // namespace ridgecast::bench
