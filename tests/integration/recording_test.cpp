// Sessions that are recorded while members of every kind fly in them, and replayed: with any number of threads and from anywhere, each
// mesh comes out as it was; what was changed in the recording is found and named.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/link/connection.h"
#include "common/edits/json.h"
#include "server/recording/format.h"
#include "server/recording/reader.h"
#include "server/recording/recorder.h"
#include "server/recording/replay.h"
#include "tests/integration/loopback.h"
#include "tests/support/crater.h"
#include "tests/support/flier.h"
#include "tests/support/process.h"
#include "tests/support/sanitized.h"
#include "tests/support/waiting.h"

namespace ridgecast {
namespace {

using namespace std::chrono_literals;
using recording::Iterated;
using recording::Record;
using testing_support::await;
using testing_support::Flier;
using Parts = std::vector<std::filesystem::path>;

constexpr int kSteps = testing_support::kSanitized ? 8 : 30;

using testing_support::m;

wire::Settings coarse(double threshold = 6) {
  wire::Settings settings;
  settings.threshold = threshold;
  settings.triangleBudget = 60'000;
  return settings;
}

class RecordingTest : public LoopbackTest {
 protected:
  void SetUp() override {
    recorder = recording::Recorder::open(folder, 1 << 26).value();
    open({}, [this](recording::World world, std::vector<recording::Edited> past, scheduling::Timer::Time now) {
      return recorder->begin(std::move(world), std::move(past), now);
    });
    ASSERT_TRUE(directory->add("stepped", base, {}, {}, wire::ClockMode::kStepped));
    listen();
    fly();
    end();
  }
  void end() {
    if (server) server->shutdown();
    executor.reset();
    server.reset();
    directory.reset();
    recorder.reset();
  }

  std::string url(const std::string& session = "default") const {
    return "ws://127.0.0.1:" + std::to_string(server->port()) + "/v1/stream?session=" + session;
  }
  camera::Camera cameraAt(double seconds, double z) const {
    camera::Camera camera;
    camera.pose.x = m(1400 + 60 * seconds);
    camera.pose.z = m(z - 20 * seconds);
    camera.pose.y = base->height({camera.pose.x, camera.pose.z}) + 90;
    camera.pose.yaw = 0.3 * std::sin(seconds);
    camera.pose.pitch = -0.3;
    return camera;
  }
  void edit(const std::string& session, const edits::Operation& operation) {
    std::promise<void> made;
    directory->find(session)->edits().ask({"", "ann", operation}, [&](const Outcome<std::uint64_t>& number, std::uint64_t) {
      EXPECT_TRUE(number);
      made.set_value();
    });
    made.get_future().wait();
  }
  static edits::Operation crater(lattice::Point at) { return {edits::Crater{at, m(12), static_cast<std::int32_t>(m(4))}, 0}; }

  // Lock-step and free pacing, changes of settings, edits and an undo, a member that comes back, a clock that is stepped.
  void fly() {
    std::optional<Flier> lockstep(std::in_place, url(), coarse()), free(std::in_place, url(), coarse(3), wire::Pacing::kFree);
    Flier beside(url("stepped"), coarse(4));
    beside.connection().setClock({true, wire::ClockMode::kStepped, 0});
    for (int k = 0; k < kSteps; ++k) {
      const camera::Camera camera = cameraAt(k * 0.2, 3600);
      if (k == kSteps / 4) edit("default", crater({camera.pose.x + m(40), camera.pose.z - m(60)}));
      if (k == kSteps / 3) lockstep->connection().change(coarse(4));
      if (k == kSteps / 2) {
        wire::Settings other = coarse(2);
        other.metric = wire::Metric::kArea;  // begins anew
        lockstep->connection().change(other);
        edit("default", {edits::Undo{1}, 0});
        edit("stepped", crater({camera.pose.x, camera.pose.z}));
        free.reset();
        free.emplace(url(), coarse(3), wire::Pacing::kFree);
      }
      lockstep->step(camera);
      free->send(cameraAt(k * 0.2, 3000));
      while (free->take(k % 3 == 0 ? 50ms : 0ms)) {
      }
      beside.connection().step({100'000, false});
      beside.step(cameraAt(k * 0.1, 2000));
    }
    wire::Query query;
    query.x = {m(10)};
    query.z = {m(-80)};
    ASSERT_TRUE(beside.connection().ask(query).get());
    lockstep.reset();
    ASSERT_TRUE(await([&] { return directory->cameras() == 2; }));
  }

  Parts parts(const std::string& session) const {
    for (const Parts& found : recording::recordingsAt(folder).value())
      if (recording::nameOf(found.front())->first.starts_with(session + ".")) return found;
    return {};
  }
  recording::Summary replay(const Parts& of, unsigned threads, const recording::Span& span = {}) {
    scheduling::Executor own(threads);
    const auto summary = recording::replay({of}, base, own, span);
    EXPECT_TRUE(summary) << summary.error().message;
    return summary ? *summary : recording::Summary{};
  }
  static std::vector<Record> read(const Parts& of) {
    auto reader = recording::Reader::open(of).value();
    std::vector<Record> out{{0, reader->world()}};
    while (auto record = reader->next()) out.push_back(std::move(*record));
    EXPECT_EQ(reader->damage(), "");
    EXPECT_FALSE(reader->wasCutOff());
    return out;
  }
  Parts write(const std::vector<Record>& records) {
    recording::Encoder encoder;
    recording::Bytes block;
    for (const Record& r : records) EXPECT_TRUE(encoder.put(r, block));
    const recording::Bytes frame = recording::compress(block);
    const std::filesystem::path file = folder / "changed.0001.recording";
    std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(frame.data()), static_cast<std::streamsize>(frame.size()));
    return {file};
  }

  testing_support::ScratchFolder scratch;
  const std::filesystem::path folder = scratch / "recordings";
  std::shared_ptr<const terrain::Terrain> base = terrain::create("alpine", 1).value();
  std::unique_ptr<recording::Recorder> recorder;
};

TEST_F(RecordingTest, IsReplayedWithAnyNumberOfThreadsAndFromAnywhere) {
  for (const std::string session : {"default", "stepped"}) {
    const Parts of = parts(session);
    ASSERT_FALSE(of.empty());
    std::uint64_t iterations = 0, clocks = 0;
    double end = 0;
    for (const Record& r : read(of)) {
      iterations += std::holds_alternative<Iterated>(r.event);
      clocks += std::holds_alternative<recording::Clocked>(r.event);
      end = static_cast<double>(r.time) / 1e6;
    }
    EXPECT_GE(iterations, static_cast<std::uint64_t>(kSteps));
    EXPECT_GE(clocks, session == "stepped" ? static_cast<std::uint64_t>(kSteps) : 1u);
    for (const unsigned threads : {1u, 2u, 8u}) {
      const auto summary = replay(of, threads);
      EXPECT_FALSE(summary.first) << summary.first->camera << ", iteration " << summary.first->iteration;
      EXPECT_EQ(summary.iterations, iterations);
      EXPECT_EQ(summary.cameras, session == "default" ? 3u : 1u);
      EXPECT_EQ(summary.edits, session == "default" ? 2u : 1u);
      EXPECT_EQ(summary.questions, session == "default" ? 0u : 1u);
      EXPECT_EQ(summary.unknown, 0u);
    }
    std::uint64_t before = 0;
    for (const double from : {0.2, 0.6, 0.95}) {
      const auto summary = replay(of, 2, {from * end});
      EXPECT_FALSE(summary.first);
      EXPECT_GT(summary.iterations, 0u);
      EXPECT_LE(summary.iterations + summary.before, iterations);
      before = summary.before;
    }
    EXPECT_GT(before, 0u);
    EXPECT_LT(replay(of, 2, {0, end / 2}).iterations, iterations);
  }
}

TEST_F(RecordingTest, APlantedDifferenceIsFoundAndNamed) {
  const std::vector<Record> records = read(parts("default"));
  // The second iteration of each camera, on its way to a finer mesh.
  std::map<std::uint64_t, std::uint64_t> seen;
  std::size_t tried = 0;
  for (std::size_t k = 0; k < records.size(); ++k) {
    const auto* i = std::get_if<Iterated>(&records[k].event);
    if (!i || ++seen[i->camera] != 2) continue;
    const auto plant = [&](auto change) {
      std::vector<Record> changed = records;
      change(std::get<Iterated>(changed[k].event));
      const auto first = replay(write(changed), 2).first;
      ASSERT_TRUE(first);
      EXPECT_EQ(first->camera, i->camera);
      EXPECT_EQ(first->iteration, 2u);
      EXPECT_NEAR(first->seconds, static_cast<double>(records[k].time) / 1e6, 1e-6);
      EXPECT_NE(first->recorded, first->repeated);
    };
    plant([](Iterated& other) { other.hash ^= 1; });
    plant([](Iterated& other) { other.insertions = 1; });
    if (++tried == 2) break;
  }
  EXPECT_EQ(tried, 2u);
}

TEST_F(RecordingTest, ContentThatMakesNoSenseIsRefused) {
  const std::vector<Record> records = read(parts("default"));
  const auto refusal = [&](const std::vector<Record>& changed) {
    scheduling::Executor own(2);
    const auto summary = recording::replay({write(changed)}, base, own, {});
    return summary ? std::string() : summary.error().message;
  };
  std::vector<Record> missing = records, hungry = records;
  std::erase_if(missing, [](const Record& r) {
    const auto* e = std::get_if<recording::Edited>(&r.event);
    return e && e->number == 1;
  });
  EXPECT_NE(refusal(missing).find("is not in the recording"), std::string::npos);
  for (Record& r : hungry)
    if (auto* j = std::get_if<recording::Joined>(&r.event)) j->granted.triangleBudget = 4'000'000'000;
  EXPECT_NE(refusal(hungry).find("no server grants"), std::string::npos);
  EXPECT_FALSE(recording::checkTerrain(std::get<recording::World>(records[0].event), *terrain::create("alpine", 2).value()));
}

TEST_F(RecordingTest, WithoutItsBeginningACameraIsUnknownAndTheOthersAreNot) {
  std::vector<Record> records = read(parts("default"));
  for (Record& r : records)
    if (auto* j = std::get_if<recording::Joined>(&r.event); j && j->camera == 1) j->again = true;
  const auto summary = replay(write(records), 2);
  EXPECT_FALSE(summary.first);
  EXPECT_GT(summary.unknown, 0u);
  EXPECT_EQ(summary.cameras, 2u);
}

}  // namespace
}  // namespace ridgecast
