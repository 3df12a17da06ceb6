// A session's log of edits on this disk: commits a second, cold starts from the cached ground and from the edits alone, what heights of
// edited ground cost, and undos beneath other edits.
#include <malloc.h>

#include <algorithm>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "server/pipeline/pipeline.h"
#include "tests/bench/bench.h"
#include "tests/bench/edit_session.h"
#include "tests/bench/usage.h"
#include "tests/support/process.h"

namespace ridgecast::bench {
namespace {

constexpr lattice::Step kMetre = lattice::kStepsPerMetre;

constexpr std::uint64_t kSquare = 1600;  // metres along each side, from the origin

lattice::Point somewhere(std::mt19937_64& random) {
  const auto place = [&] { return static_cast<lattice::Step>(random() % (kSquare * kMetre)); };
  const lattice::Step x = place();
  return {x, place()};
}

using Make = edits::Operation (*)(std::mt19937_64& random, std::uint64_t number);

// 2 m wide.
edits::Operation smallEdit(std::mt19937_64& random, std::uint64_t) {
  const lattice::Point at = somewhere(random);
  return {edits::Raise{at, kMetre, 0, static_cast<std::int32_t>(random() % 512)}, 0};
}

// One of the seven kinds, each as often, as people make them by hand: 2 to 10 m wide, level ground of four corners, roads of four points,
// stamps of 16 x 16 samples.
edits::Operation anyEdit(std::mt19937_64& random, std::uint64_t number) {
  const lattice::Point at = somewhere(random);
  const auto upTo = [&](std::int64_t most) { return static_cast<std::int32_t>(random() % static_cast<std::uint64_t>(most)); };
  const lattice::Step radius = kMetre + upTo(4 * kMetre);
  const std::uint32_t material = static_cast<std::uint32_t>(upTo(edits::kMaterials + 1));
  switch (upTo(7)) {
    case 0:
      return {edits::Crater{at, radius, static_cast<std::int32_t>(radius / 3)}, material};
    case 1: {
      const lattice::Step side = 2 * radius;
      return {edits::Level{{at, {at.x + side, at.z}, {at.x + side, at.z + side}, {at.x, at.z + side}}, 0, 400'000 + upTo(9999), 256},
              material};
    }
    case 2:
      return {edits::Smooth{at, radius, 4}, material};
    case 3: {
      edits::Road road;
      for (int k = 0; k < 4; ++k) road.line.push_back({at.x + 8 * k * kMetre, at.z + upTo(4 * kMetre), 0});
      road.width = 3 * kMetre;
      return {road, material};
    }
    case 4: {
      edits::Stamp stamp{at, 16, 16, 1, {}};
      for (int k = 0; k < 256; ++k) stamp.samples.push_back(upTo(kMetre));
      return {stamp, material};
    }
    case 5:
      if (number > 500) return {edits::Undo{number - 500}, 0};
      [[fallthrough]];
    default:
      return {edits::Raise{at, radius, 0, upTo(512)}, material};
  }
}

double commits(const std::filesystem::path& file, const std::shared_ptr<const terrain::Terrain>& terrain, std::size_t group, int count) {
  EditSession session = EditSession::open(file, terrain);
  std::mt19937_64 random(1);
  const Clock clock;
  for (int k = 0; k < count; ++k) {
    std::vector<edits::Operation> operations;
    for (std::size_t n = 0; n < group; ++n) operations.push_back(smallEdit(random, 0));
    session.append(std::move(operations));
  }
  return count / clock.seconds();
}

constexpr std::size_t kBatch = 256;

// Of the processor; without what looking at the clock takes.
template <class Do>
double secondsOf(const Do& act) {
  static const double clock = [] {
    std::vector<double> looks;
    for (int k = 0; k < 1001; ++k) {
      const double start = cpuSeconds();
      looks.push_back(cpuSeconds() - start);
    }
    return median(looks);
  }();
  const double start = cpuSeconds();
  act();
  return cpuSeconds() - start - clock;
}

// How much longer heights take with edits, in batches whose places lie within some metres of each other, anywhere in the 1,600 m: the
// median of paired runs.
double slowdown(const terrain::Terrain& plain, const terrain::Terrain& edited, lattice::Point corner, std::uint64_t within, int batches) {
  std::mt19937_64 random(3);
  std::vector<double> ratios;
  std::vector<lattice::Step> x(kBatch), z(kBatch);
  std::vector<float> out(kBatch);
  for (int run = 0; run < 9; ++run) {
    double seconds[2] = {0, 0};
    for (int batch = 0; batch < batches; ++batch) {
      const auto near = [&](std::uint64_t metres) { return static_cast<lattice::Step>(random() % (metres * kMetre)); };
      const lattice::Point place{corner.x + near(kSquare - within), corner.z + near(kSquare - within)};
      for (std::size_t k = 0; k < kBatch; ++k) x[k] = place.x + near(within), z[k] = place.z + near(within);
      for (const std::size_t which : {batch % 2, 1 - batch % 2}) {
        seconds[which] += secondsOf([&] { (which == 1 ? edited : plain).heights(x, z, out); });
      }
    }
    ratios.push_back(seconds[1] / seconds[0]);
  }
  return median(ratios);
}

// Edited ground that asks the plain terrain, too, whatever it is asked, and takes both times.
class Compared final : public terrain::Terrain {
 public:
  Compared(std::shared_ptr<const terrain::Terrain> plain, std::shared_ptr<const edits::Layer> layer)
      : plain_(plain), edited_(std::move(plain), std::move(layer)) {}
  std::string_view name() const override { return plain_->name(); }
  std::string_view source() const override { return plain_->source(); }
  std::uint32_t seed() const override { return plain_->seed(); }
  const terrain::Raster* edits() const override { return edited_.edits(); }
  terrain::Colours colours() const override { return edited_.colours(); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    std::size_t inside = 0;
    for (std::size_t k = 0; k < out.size(); ++k)
      inside += std::min(x[k], z[k]) >= 0 && std::max(x[k], z[k]) < lattice::Step{kSquare} * kMetre;
    other_.resize(out.size());
    turn_ = 1 - turn_;
    double seconds[2];
    for (const std::size_t which : {turn_, 1 - turn_}) {
      seconds[which] = which == 1 ? secondsOf([&] { edited_.heights(x, z, out); }) : secondsOf([&] { plain_->heights(x, z, other_); });
    }
    all_.add(seconds);
    if (inside == out.size()) inside_.add(seconds);
    if (inside == 0) outside_.add(seconds);
  }
  struct Times {
    double plain = 0, edited = 0;
    void add(const double (&seconds)[2]) { plain += seconds[0], edited += seconds[1]; }
  };
  const Times& all() const { return all_; }
  const Times& inside() const { return inside_; }
  const Times& outside() const { return outside_; }

 private:
  std::shared_ptr<const terrain::Terrain> plain_;
  edits::EditedTerrain edited_;
  mutable std::vector<float> other_;
  mutable std::size_t turn_ = 0;
  mutable Times all_, inside_, outside_;
};

// What a mesh asks for that settles and then flies over edited ground, on one thread.
void fly(const std::shared_ptr<const Compared>& terrain, int iterations) {
  scheduling::Executor executor(1);
  pipeline::Pipeline pipeline(terrain, pipeline::grant({}, {}), executor.makePool(1));
  for (int n = 0; n < iterations || !pipeline.settled(); ++n) {
    camera::Camera camera;
    camera.pose.x = (200 + 5 * std::min(n, iterations)) * kMetre;
    camera.pose.z = 800 * kMetre;
    camera.pose.y = terrain->height({camera.pose.x, camera.pose.z}) + 60;
    camera.pose.yaw = -1.5708;
    camera.pose.pitch = -0.2;
    pipeline.iterate(camera);
  }
}

constexpr std::uint64_t kTurn = 20'000;  // posts

// All of it, and its longest turn.
void addUndo(Report& report, const std::string& name, edits::History& history, std::uint64_t edit) {
  edits::History::Making making = history.make({edits::Undo{edit}, 0});
  double all = 0, longest = 0;
  for (bool isDone = false; !isDone;) {
    const double start = cpuSeconds();
    isDone = making.step(kTurn);
    const double seconds = cpuSeconds() - start;
    all += seconds;
    longest = std::max(longest, seconds);
  }
  making.result().value();
  report.add("undo_" + name, 1000 * all, "ms");
  report.add("undo_" + name + "_longest_turn", 1000 * longest, "ms");
}

// Undos beneath many others at one place and elsewhere.
void addUndos(Report& report, const std::shared_ptr<const terrain::Terrain>& terrain, int count) {
  const auto crater = [](int x, int z) { return edits::Operation{edits::Crater{{x * kMetre, z * kMetre}, 3 * kMetre, 99}, 0}; };
  edits::History elsewhere(terrain), there(terrain), wide(terrain);
  elsewhere.add(crater(0, 0)).value();
  for (int k = 0; k < count; ++k) elsewhere.add(crater(20 + k % 100 * 10, k / 100 * 10)).value();
  addUndo(report, "beneath_" + std::to_string(count) + "_elsewhere", elsewhere, 1);
  for (int k = 0; k < count; ++k) there.add(crater(k % 4, k % 3)).value();
  addUndo(report, "of_the_first_of_" + std::to_string(count) + "_at_one_place", there, 1);
  addUndo(report, "of_the_last_of_" + std::to_string(count) + "_at_one_place", there, static_cast<std::uint64_t>(count));
  for (int k = 0; k < 16; ++k) wide.add({edits::Level{{{k * kMetre, 0}}, 250 * kMetre, 250'000 + 99 * k, 256}, 0}).value();
  addUndo(report, "of_the_first_of_16_wide_levels", wide, 1);
  addUndo(report, "of_the_last_of_16_wide_levels", wide, 16);
}

// Resident memory that is not ground. What was freed before does not count.
class Memory {
 public:
  Memory() {
    malloc_trim(0);
    before_ = residentBytes();
  }
  double besides(const edits::Layer& layer) const { return (residentBytes() - before_ - static_cast<double>(layer.bytes())) / (1 << 20); }

 private:
  double before_ = 0;
};

// A session of so many edits: how long making them takes and beginning again, from the cached ground and from the edits alone, what memory
// it has beside its ground, and the undo of the first edit. Returns it as begun again.
EditSession addSession(Report& report, const std::string& name, const std::filesystem::path& file,
                       const std::shared_ptr<const terrain::Terrain>& terrain, Make make, std::size_t count) {
  constexpr std::size_t kGroup = 4000;
  {
    const Memory memory;
    EditSession session = EditSession::open(file, terrain);
    std::mt19937_64 random(2);
    const double before = cpuSeconds();
    const Clock clock;
    double said = 0;
    while (session.history.last() < count) {
      std::vector<edits::Operation> operations;
      for (std::uint64_t n = session.history.last() + 1; operations.size() < kGroup; ++n) operations.push_back(make(random, n));
      session.append(std::move(operations));
      if (clock.seconds() - said > 10) {
        said = clock.seconds();
        progress(name + ": " + std::to_string(session.history.last()) + " of " + std::to_string(count) + " edits made");
      }
    }
    report.add(name + "_edits", static_cast<double>(session.history.last()));
    report.add(name + "_made_in", cpuSeconds() - before, "s");
    report.add(name + "_memory_made", memory.besides(*session.history.layer()), "MiB beside the ground");
  }
  report.add(name + "_bytes_an_edit_in_the_file", static_cast<double>(std::filesystem::file_size(file)) / static_cast<double>(count), "B");
  const Memory memory;
  double start = cpuSeconds();
  EditSession session = EditSession::open(file, terrain);
  report.add(name + "_cold_start", cpuSeconds() - start, "s");
  report.add(name + "_tiles", static_cast<double>(session.history.layer()->tiles()));
  report.add(name + "_layer", static_cast<double>(session.history.layer()->bytes()) / (1 << 20), "MiB");
  report.add(name + "_memory_begun_again", memory.besides(*session.history.layer()), "MiB beside the ground");
  start = cpuSeconds();
  session.history.replay().value();
  report.add(name + "_replay", cpuSeconds() - start, "s");
  report.add(name + "_memory_replayed", memory.besides(*session.history.layer()), "MiB beside the ground");
  addUndo(report, name + "_beneath_" + std::to_string(count), session.history, 1);
  report.add(name + "_memory_undone", memory.besides(*session.history.layer()), "MiB beside the ground");
  return session;
}

}  // namespace

Report edits(const Options& options) {
  const testing_support::ScratchFolder folder;
  const auto terrain = terrain::create("alpine", 1).value();
  Report report;
  for (const std::size_t group : {1, 16})
    report.add("commits_per_second_of_" + std::to_string(group),
               commits(folder / ("commits" + std::to_string(group)), terrain, group, options.quick ? 50 : 500), "1/s");

  const std::size_t count = !options.arguments.empty() ? std::stoull(options.arguments.front()) : options.quick ? 20'000 : 1'000'000;
  addSession(report, "all_kinds", folder / "all_kinds", terrain, anyEdit, count);
  EditSession session = addSession(report, "small", folder / "small", terrain, smallEdit, count);
  const int batches = options.quick ? 20 : 500;
  for (const std::string name : {"alpine", "archipelago"}) {
    const auto plain = terrain::create(name, 1).value();
    const edits::EditedTerrain edited(plain, session.history.layer());
    for (const std::uint64_t within : {8, 32, 128, 1500})
      report.add("heights_" + name + "_within_" + std::to_string(within) + "_m", slowdown(*plain, edited, {0, 0}, within, batches),
                 "times");
    report.add("heights_" + name + "_elsewhere", slowdown(*plain, edited, {10'000 * kMetre, 0}, 32, batches), "times");
    const auto compared = std::make_shared<const Compared>(plain, session.history.layer());
    fly(compared, options.quick ? 10 : 200);
    const Compared::Times &inside = compared->inside(), &outside = compared->outside(), &all = compared->all();
    report.add("heights_" + name + "_of_a_mesh", inside.edited / inside.plain, "times");
    report.add("heights_" + name + "_of_a_mesh_elsewhere", outside.edited / outside.plain, "times");
    report.add("heights_" + name + "_of_a_mesh_all", all.edited / all.plain, "times, with those at the border");
  }
  addUndos(report, terrain, options.quick ? 1000 : 10'000);

  // Ground as large as a session may have.
  const auto large = folder / "large";
  {
    EditSession made = EditSession::open(large, terrain);
    for (int k = 0; k < (options.quick ? 4 : 192); ++k)
      made.append({{edits::Raise{{k % 12 * 600 * kMetre, k / 12 * 600 * kMetre}, 256 * kMetre, 0, 9999}, 1}});
  }
  const double start = cpuSeconds();
  const EditSession largest = EditSession::open(large, terrain);
  report.add("large_cold_start", cpuSeconds() - start, "s");
  report.add("large_tiles", static_cast<double>(largest.history.layer()->tiles()));
  report.add("large_layer", static_cast<double>(largest.history.layer()->bytes()) / (1 << 20), "MiB");
  report.add("large_bytes_a_tile_in_the_file",
             static_cast<double>(std::filesystem::file_size(large)) / static_cast<double>(largest.history.layer()->tiles()), "B");
  report.note("seconds are of the processor; commits are synced to " + std::filesystem::temp_directory_path().string());
  return report;
}

}  // namespace ridgecast::bench
