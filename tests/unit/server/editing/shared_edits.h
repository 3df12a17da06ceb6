#pragma once
// Several servers' edits of one session, through an engine that fails. The judge has the engine's log, and the ground that the log's
// operations make.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/edited_terrain.h"
#include "common/edits/packed.h"
#include "common/terrain/terrain.h"
#include "server/edit_log/entry.h"
#include "server/editing/edits.h"
#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::editing {

using namespace std::chrono_literals;

// A disk, which outlives its server.
struct Disk {
  std::vector<Applied> edits;
  bool fails = false;
  int setAside = 0;
};
class DiskStore final : public edit_store::Store {
 public:
  explicit DiskStore(std::shared_ptr<Disk> disk) : disk_(std::move(disk)) {}
  std::uint64_t last() const override { return disk_->edits.size(); }
  std::uint64_t compacted() const override { return 0; }
  std::uint64_t bytes() const override { return 0; }
  Outcome<void> append(std::span<const Applied> edits, const edit_store::Change&) override {
    if (disk_->fails) return Error{"There is no room on the disk."};
    for (const Applied& e : edits) {
      EXPECT_EQ(e.number, disk_->edits.size() + 1);
      EXPECT_TRUE(e.key.empty() || std::ranges::find(disk_->edits, e.key, &Applied::key) == disk_->edits.end()) << e.key << " twice";
      disk_->edits.push_back(e);
    }
    return {};
  }
  Outcome<std::vector<Applied>> read(std::uint64_t after, std::size_t most) override {
    std::vector<Applied> out;
    for (std::size_t bytes = 0; after < disk_->edits.size(); ++after) {
      bytes += disk_->edits[after].bytes();
      if (bytes > most && !out.empty()) break;
      out.push_back(disk_->edits[after]);
    }
    return out;
  }
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) override {
    const auto found = std::ranges::find(disk_->edits, key, &Applied::key);
    return found == disk_->edits.end() ? std::optional<std::uint64_t>() : std::optional(found->number);
  }

 private:
  const std::shared_ptr<Disk> disk_;
};

struct World {
  explicit World(std::uint64_t seed = 1) : random(seed), engine(timer, seed) {}
  std::uint64_t upTo(std::uint64_t most) { return random() % most; }
  std::shared_ptr<const terrain::Terrain> terrain = terrain::create("alpine", 1).value();
  std::mt19937_64 random;
  testing_support::SimulatedTimer timer;
  testing_support::SimulatedEngine engine;
};

// One server's edits. Nothing happens but by work().
struct Machine {
  explicit Machine(World& w) : world(w) { start(); }
  ~Machine() { kill(); }

  void start() {
    bus = world.engine.connect();
    executor = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
    writer = std::make_unique<scheduling::Executor>(scheduling::Executor::WithoutThreads{});
    life = std::make_shared<bool>(true);
    hasLeft = false;
    Edits::Kept kept;
    kept.makeStore = [disk = disk](std::string_view) -> Outcome<std::unique_ptr<edit_store::Store>> {
      if (disk->fails) return Error{"There is no room for a log."};
      return std::unique_ptr<edit_store::Store>(new DiskStore(disk));
    };
    if (!disk->edits.empty()) {
      kept.store = std::make_unique<DiskStore>(disk);
      kept.history.emplace(world.terrain);
      for (const Applied& e : disk->edits) kept.history->add(edits::unpack(e.operation).value()).value();
    }
    kept.setAside = [disk = disk] { ++disk->setAside, disk->edits.clear(); };
    kept.left = [this] { hasLeft = true; };
    noted.clear();
    edits = std::make_shared<Edits>(
        world.terrain, *executor, *writer, space, [] {}, std::move(kept), [this](const Applied& made) { noted.push_back(made); }, 10s,
        EditOrder::Shared{bus, "world", std::shared_ptr<const scheduling::Timer>(&world.timer, [](const scheduling::Timer*) {})});
    edits->begin();
  }
  void work() {
    executor->work();
    for (; writer->queued() > 0; executor->work()) writer->work();
  }
  // Nothing of what it still does leaves it.
  void kill() {
    if (!edits) return;
    *life = false;
    auto lost = std::exchange(disk, std::make_shared<Disk>(*disk));
    world.engine.cut(*bus);
    edits->end();
    for (int k = 0; k < 20; ++k) world.timer.advance(100ms), work();
    edits.reset();
    work();
    bus.reset();
    world.timer.advance(0s);
    executor.reset(), writer.reset();
  }
  using Said = std::shared_ptr<std::optional<Edits::Answer>>;
  Said ask(edits::Operation operation, const std::string& author = "ann", const std::string& key = "") {
    auto said = std::make_shared<std::optional<Edits::Answer>>();
    edits->ask({key, author, std::move(operation)}, [said, life = life](const Edits::Answer& answer, std::uint64_t) {
      if (!*life) return;
      EXPECT_FALSE(*said) << "answered twice";
      *said = answer;
    });
    return said;
  }
  std::uint64_t hash() const {
    const auto ground = edits->ground();
    const auto layer = edits::layerOf(*ground.terrain);
    return layer ? layer->hash() : 0;
  }

  World& world;
  std::shared_ptr<bus::Bus> bus;
  std::unique_ptr<scheduling::Executor> executor, writer;
  std::shared_ptr<Disk> disk = std::make_shared<Disk>();
  std::shared_ptr<EditSpace> space = std::make_shared<EditSpace>();
  std::shared_ptr<bool> life;
  bool hasLeft = false;
  std::vector<Applied> noted;
  std::shared_ptr<Edits> edits;
};

// Some servers, and all of them as time goes on.
struct Rig {
  explicit Rig(std::size_t servers, std::uint64_t seed = 1) : world(seed) {
    for (std::size_t k = 0; k < servers; ++k) all.push_back(std::make_unique<Machine>(world));
    run(50ms);
  }
  Machine& operator[](std::size_t k) { return *all[k]; }
  void work() {
    for (const auto& machine : all)
      if (machine->edits) machine->work();
  }
  void run(scheduling::Timer::Time::duration time) {
    work();
    for (const auto end = world.timer.now() + time; world.timer.step(end);) work();
    work();
  }
  // The log's operations, applied by the judge.
  void expectOneGround() {
    const auto log = world.engine.log("world");
    edits::History history(world.terrain);
    for (const bus::Entry& e : log) {
      const auto entry = edit_log::unpackEntry(e.bytes).value();
      EXPECT_EQ(entry.edit.number, e.number);
      history.add(edits::unpack(entry.edit.operation).value()).value();
    }
    for (std::size_t k = 0; k < all.size(); ++k) {
      ASSERT_EQ(all[k]->edits->ground().edit, log.size()) << "server " << k;
      EXPECT_EQ(all[k]->hash(), history.layer()->hash()) << "server " << k;
      EXPECT_TRUE(all[k]->edits->isCurrent()) << "server " << k;
    }
  }
  World world;
  std::vector<std::unique_ptr<Machine>> all;
};

}  // namespace ridgecast::editing
