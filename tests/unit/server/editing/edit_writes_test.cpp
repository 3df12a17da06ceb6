// A session's edits and the disk: what is kept in one write, who waits for it, what a failure leaves, and what edits may take.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <new>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/packed.h"
#include "server/directory/directory.h"
#include "server/member/camera_session.h"
#include "tests/support/crater.h"
#include "tests/support/decoded.h"
#include "tests/support/simulated_timer.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::editing {
namespace {

using directory::Directory;
using member::CameraSession;
using session::flatTerrain, session::Resources, session::Script, session::scriptedMeshes;
using testing::HasSubstr;
using testing_support::craterAt;
using testing_support::m;

// Of about 2 bytes a sample.
edits::Operation noisyStamp(std::uint32_t side, std::uint32_t seed = 1) {
  std::mt19937 random(seed);
  edits::Stamp out{{0, 0}, side, side, 1, {}};
  for (std::uint32_t k = 0; k < side * side; ++k) out.samples.push_back(static_cast<std::int32_t>(random() % 1024));
  return {std::move(out), 0};
}

// Keeps edits in memory; `write` is asked before each append.
struct Disk {
  std::vector<std::vector<Applied>> writes;
  std::function<Outcome<void>()> write = [] { return Outcome<void>(); };
  bool cannotRead = false;
};
class MemoryStore final : public edit_store::Store {
 public:
  explicit MemoryStore(std::shared_ptr<Disk> disk) : disk_(std::move(disk)) {}
  std::uint64_t last() const override { return all_.size(); }
  std::uint64_t compacted() const override { return 0; }
  std::uint64_t bytes() const override { return 0; }
  Outcome<void> append(std::span<const Applied> edits, const edit_store::Change&) override {
    if (auto written = disk_->write(); !written) return written;
    disk_->writes.emplace_back(edits.begin(), edits.end());
    all_.insert(all_.end(), edits.begin(), edits.end());
    return {};
  }
  Outcome<std::vector<Applied>> read(std::uint64_t after, std::size_t most) override {
    std::vector<Applied> out;
    for (std::size_t bytes = 0; after < all_.size() && (out.empty() || bytes < most); bytes += all_[after++].bytes())
      out.push_back(all_[after]);
    return out;
  }
  Outcome<std::optional<std::uint64_t>> numberOf(const std::string& key) override {
    if (disk_->cannotRead) return Error{"The disk cannot be read."};
    for (const Applied& e : all_)
      if (e.key == key) return std::optional(e.number);
    return std::optional<std::uint64_t>();
  }

 private:
  const std::shared_ptr<Disk> disk_;
  std::vector<Applied> all_;
};

// Nothing happens but by work().
struct Steps {
  explicit Steps(std::shared_ptr<const terrain::Terrain> terrain = flatTerrain(), const EditSpace::Limits& limits = {})
      : space(std::make_shared<EditSpace>(limits)) {
    Edits::Kept kept;
    kept.makeStore = [disk = disk](std::string_view) -> Outcome<std::unique_ptr<edit_store::Store>> {
      return std::unique_ptr<edit_store::Store>(new MemoryStore(disk));
    };
    edits = std::make_shared<Edits>(
        std::move(terrain), executor, writer, space, [] {}, std::move(kept));
  }
  using Said = std::shared_ptr<std::optional<Edits::Answer>>;
  Said ask(edits::Operation operation, const std::string& key = "", Edits::Pay pay = {}) {
    auto said = std::make_shared<std::optional<Edits::Answer>>();
    edits->ask(
        {key, "ann", std::move(operation)}, [said](const Edits::Answer& answer, std::uint64_t) { *said = answer; }, std::move(pay));
    return said;
  }
  void work() {
    for (int k = 0; k < 50; ++k) writer.work(), executor.work();
  }
  scheduling::Executor executor{scheduling::Executor::WithoutThreads{}}, writer{scheduling::Executor::WithoutThreads{}};
  std::shared_ptr<Disk> disk = std::make_shared<Disk>();
  std::shared_ptr<EditSpace> space;
  std::shared_ptr<Edits> edits;
};

TEST(EditWrites, ThoseThatWaitAreKeptInOneWriteAndAcknowledgedAfterIt) {
  Steps steps;
  std::vector<Steps::Said> first, second;
  for (int k = 0; k < 10; ++k) first.push_back(steps.ask(craterAt(k), k % 2 ? "key " + std::to_string(k) : ""));
  steps.writer.work();    // looks their keys up
  steps.executor.work();  // makes them
  EXPECT_TRUE(steps.disk->writes.empty());
  for (int k = 0; k < 5; ++k) second.push_back(steps.ask(craterAt(100 + k)));
  const auto again = steps.ask(craterAt(1), "key 1");  // which is being kept
  for (const auto& said : first) EXPECT_FALSE(*said);
  EXPECT_EQ(steps.edits->ground().edit, 0u);
  steps.writer.work();  // keeps them
  ASSERT_EQ(steps.disk->writes.size(), 1u);
  EXPECT_EQ(steps.disk->writes[0].size(), 10u);
  for (const auto& said : first) EXPECT_FALSE(*said) << "acknowledged before everybody has its ground";
  steps.work();
  for (std::size_t k = 0; k < first.size(); ++k) EXPECT_EQ((*first[k])->value(), k + 1);
  for (std::size_t k = 0; k < second.size(); ++k) EXPECT_EQ((*second[k])->value(), k + 11);
  EXPECT_EQ((*again)->value(), 2u);
  ASSERT_EQ(steps.disk->writes.size(), 2u);
  EXPECT_EQ(steps.disk->writes[1].size(), 5u);
  EXPECT_EQ(steps.edits->ground().edit, 15u);
  EXPECT_EQ(steps.space->waiting.used(), 0u);
}

TEST(EditWrites, AFailedOneTakesAllOfItBack) {
  Steps steps;
  const auto kept = steps.ask(craterAt(0), "a");
  steps.work();
  EXPECT_EQ((*kept)->value(), 1u);
  const std::uint64_t bytes = steps.space->kept.used();
  const auto ground = steps.edits->ground();
  steps.disk->write = [] { return Outcome<void>(Error{"There is no room on the disk."}); };
  std::vector<Steps::Said> lost;
  for (int k = 0; k < 3; ++k) lost.push_back(steps.ask(craterAt(50 * k), "b" + std::to_string(k)));
  const auto known = steps.ask(craterAt(0), "a"), wrong = steps.ask({edits::Undo{99}, 0});
  steps.work();
  for (const auto& said : lost) EXPECT_EQ((*said)->error().message, "There is no room on the disk.");
  EXPECT_EQ((*known)->value(), 1u) << "it was made before";
  EXPECT_THAT((*wrong)->error().message, HasSubstr("There is no edit 99"));
  EXPECT_EQ(steps.edits->ground().edit, 1u);
  EXPECT_EQ(steps.edits->ground().terrain, ground.terrain);
  EXPECT_EQ(steps.space->kept.used(), bytes);
  steps.disk->write = [] { return Outcome<void>(); };
  const auto next = steps.ask(craterAt(0), "b0");
  steps.work();
  EXPECT_EQ((*next)->value(), 2u) << "without a gap";
}

TEST(EditWrites, ADiskThatCannotBeReadIsNotTheClientsFault) {
  Steps steps;
  const auto kept = steps.ask(craterAt(0), "a");
  steps.work();
  steps.disk->cannotRead = true;
  const auto refused = steps.ask(craterAt(9), "b");
  steps.work();
  ASSERT_FALSE(**refused);
  EXPECT_EQ((*refused)->why, Edits::Answer::Why::kFull);
  EXPECT_EQ(steps.edits->ground().edit, 1u);
}

// Runs out of memory when its heights are wanted, as level ground does.
class Greedy final : public terrain::Terrain {
 public:
  explicit Greedy(const bool& isOut) : isOut_(isOut) {}
  std::string_view name() const override { return flat_->name(); }
  std::string_view source() const override { return flat_->source(); }
  std::uint32_t seed() const override { return flat_->seed(); }
  void heights(std::span<const lattice::Step> x, std::span<const lattice::Step> z, std::span<float> out) const override {
    if (isOut_) throw std::bad_alloc();
    flat_->heights(x, z, out);
  }

 private:
  const std::shared_ptr<const terrain::Terrain> flat_ = flatTerrain();
  const bool& isOut_;
};

TEST(EditWrites, MemoryThatRunsOutRefusesAnEditAndEndsNothing) {
  bool isOut = false;
  Steps steps(std::make_shared<Greedy>(isOut));
  const auto first = steps.ask(craterAt(0), "a");
  steps.work();
  isOut = true;
  const edits::Operation level{edits::Level{{{0, 0}}, m(5), 0, 256}, 0};
  const auto greedy = steps.ask(level, "b"), modest = steps.ask(craterAt(50));
  steps.work();
  ASSERT_FALSE(**greedy);
  EXPECT_THAT((*greedy)->error().message, HasSubstr("ran out of memory"));
  EXPECT_EQ((*greedy)->why, Edits::Answer::Why::kFull);
  EXPECT_EQ((*modest)->value(), 2u);
  isOut = false;
  const auto again = steps.ask(level, "b");
  steps.work();
  EXPECT_EQ((*again)->value(), 3u);
}

TEST(EditSpaces, AreTakenWhenAskedAndGivenBack) {
  const edits::Operation stamp = noisyStamp(64);
  const std::size_t bytes = edits::pack(stamp).size() + 67;  // with "ann" and all that each has
  const EditSpace::Limits limits{9 * bytes / 2, 15 * bytes / 2, 7 * bytes / 2, 11 * bytes / 2};
  Steps steps(flatTerrain(), limits);
  const auto pays = [](const edits::Operation&, std::size_t) { return Outcome<void>(); };
  const auto one = steps.ask(stamp, "", pays), two = steps.ask(stamp, "", pays);
  ASSERT_TRUE(*two);
  EXPECT_THAT((*two)->error().message, HasSubstr("of your edits wait"));  // half of all
  EXPECT_EQ((*two)->why, Edits::Answer::Why::kEarly);
  const auto others = {steps.ask(stamp), steps.ask(stamp)};
  const auto tooMany = steps.ask(stamp);
  EXPECT_THAT((*tooMany)->error().message, HasSubstr("of edits of this session wait"));
  Edits::Kept kept;
  const auto neighbour = std::make_shared<Edits>(
      flatTerrain(), steps.executor, steps.writer, steps.space, [] {}, std::move(kept));
  std::vector<std::optional<Edits::Answer>> answers(3);
  for (auto& answer : answers) neighbour->ask({"", "bob", stamp}, [&answer](const Edits::Answer& a, std::uint64_t) { answer = a; });
  EXPECT_FALSE(answers[1]);
  ASSERT_TRUE(answers[2]);
  EXPECT_THAT(answers[2]->error().message, HasSubstr("of this server's edits wait"));
  steps.work();
  EXPECT_EQ(steps.space->waiting.used(), 0u);
  EXPECT_TRUE(**one);
  for (const auto& other : others) EXPECT_TRUE(**other);
  EXPECT_TRUE(*answers[0]);
  EXPECT_TRUE(*answers[1]);

  // Now 3 and 2 are kept.
  const auto fourth = steps.ask(stamp);
  steps.work();
  EXPECT_TRUE(**fourth);
  const auto fifth = steps.ask(stamp);
  steps.work();
  ASSERT_FALSE(**fifth);
  EXPECT_EQ((*fifth)->why, Edits::Answer::Why::kFull);
  EXPECT_THAT((*fifth)->error().message, HasSubstr("This session's edits have"));
  for (auto& answer : answers) {
    answer.reset();
    neighbour->ask({"", "bob", stamp}, [&answer](const Edits::Answer& a, std::uint64_t) { answer = a; });
    steps.work();
  }
  ASSERT_FALSE(*answers[2]);
  EXPECT_EQ(answers[2]->why, Edits::Answer::Why::kFull);
  EXPECT_THAT(answers[2]->error().message, HasSubstr("The edits of this server's sessions have"));
  steps.edits->end();
  steps.work();
  steps.edits.reset();
  neighbour->ask({"", "bob", stamp}, [&](const Edits::Answer& a, std::uint64_t) { answers[2] = a; });
  steps.work();
  EXPECT_TRUE(*answers[2]) << "a session that has ended takes none";
}

// A client that reads nothing: tickets are kept.
class Deaf final : public conversation::Sender {
 public:
  void send(wire::ServerMessage, std::shared_ptr<const void> ticket) override { tickets_.push_back(std::move(ticket)); }
  void sendShared(std::shared_ptr<const std::string> encoded, std::shared_ptr<const void> ticket) override {
    pages.push_back(std::move(encoded));
    tickets_.push_back(std::move(ticket));
  }
  std::size_t queuedBytes() const override { return 0; }
  void fail(wire::ErrorMessage) override {}
  void read() { tickets_.clear(); }
  std::vector<std::shared_ptr<const std::string>> pages;

 private:
  std::vector<std::shared_ptr<const void>> tickets_;
};

TEST(EditPages, WaitForWhoDoesNotReadAndAreCodedOnceForAll) {
  scheduling::Executor executor{scheduling::Executor::WithoutThreads{}};
  auto script = std::make_shared<Script>();
  script->next = [](int, const camera::Camera&) { return Script::State{{{{0, 0, 0}, 1}}, true}; };
  auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  resources->makeMesh = scriptedMeshes(script);
  auto timer = std::make_unique<testing_support::SimulatedTimer>();
  testing_support::SimulatedTimer& clock = *timer;
  resources->timer = std::move(timer);
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  const auto session = directory->find("default");
  const auto run = [&](int milliseconds) {
    executor.work();
    for (const auto end = clock.now() + std::chrono::milliseconds(milliseconds); clock.step(end);) executor.work();
  };
  constexpr std::uint64_t kStamps = 12;
  for (std::uint64_t k = 0; k < kStamps; ++k)
    session->edits().ask({"", "ann", noisyStamp(128, static_cast<std::uint32_t>(k))}, [](const Edits::Answer&, std::uint64_t) {});
  run(10);
  ASSERT_EQ(session->ground().edit, kStamps);
  std::vector<std::shared_ptr<Deaf>> clients;
  std::vector<std::shared_ptr<CameraSession>> cameras;
  for (int k = 0; k < 5; ++k) {
    clients.push_back(std::make_shared<Deaf>());
    cameras.push_back(std::make_shared<CameraSession>(session, session->enter().value(), directory->nextCameraId(), clients.back()));
    wire::Hello hello;
    hello.edits = true;
    cameras.back()->receive(hello);
  }
  run(60'000);
  for (const auto& client : clients) ASSERT_EQ(client->pages.size(), 1u) << "they read nothing";
  std::uint64_t followed = 0;
  for (std::size_t page = 0; followed < kStamps; ++page) {
    ASSERT_EQ(clients[0]->pages.size(), page + 1);
    for (const auto& client : clients) EXPECT_EQ(client->pages.at(page).get(), clients[0]->pages[page].get()) << "coded once";
    const auto message = testing_support::decoded(*clients[0]->pages[page]);
    for (const wire::MadeEdit& made : std::get<wire::Edited>(message).edits) EXPECT_EQ(made.number, ++followed);
    EXPECT_LE(clients[0]->pages[page]->size(), EditPages::kMaxBytes + 10'000);
    for (const auto& client : clients) client->read();
    run(100);
  }
  EXPECT_GT(clients[0]->pages.size(), 3u);
  for (const auto& camera : cameras) camera->close();
  run(1000);
}

}  // namespace
}  // namespace ridgecast::editing
