#include "server/recording/merged.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "server/logging/logging.h"
#include "server/recording/recorder.h"
#include "tests/support/process.h"
#include "tests/support/recorded_events.h"

namespace ridgecast::recording {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing_support::recordedWorld;

constexpr std::int64_t kSecond = 1'000'000;

class MergedTest : public testing::Test {
 protected:
  void SetUp() override { logging::setUp(logging::Format::kText, logging::Level::kOff); }

  // A server's recording that began this much after the first.
  Parts record(std::int64_t began, const std::vector<Record>& records, std::vector<Edited> past = {}, World world = recordedWorld()) {
    const fs::path folder = scratch / std::to_string(++servers_);
    {
      const auto recorder = Recorder::open(folder, 1 << 24).value();
      const Observer::Instant start = Observer::Instant::clock::now();
      const auto observer = recorder->begin(std::move(world), std::move(past), start);
      for (const Record& record : records) observer->note(start + std::chrono::microseconds(record.time), record.event);
    }
    const Parts parts = recordingsAt(folder).value().at(0);
    shift(parts, began);
    return parts;
  }
  static Joined joined(std::uint64_t camera) { return {camera, "", wire::Role::kViewer, wire::Pacing::kFree, {}, 0}; }
  static std::vector<Record> all(const std::vector<Parts>& recordings, std::string* damage = nullptr) {
    const auto records = openRecords(recordings).value();
    std::vector<Record> out;
    while (auto record = records->next()) out.push_back(std::move(*record));
    if (damage) *damage = records->damage();
    return out;
  }
  template <class T>
  static std::vector<std::pair<std::int64_t, T>> of(const std::vector<Record>& records) {
    std::vector<std::pair<std::int64_t, T>> out;
    for (const Record& record : records)
      if (const T* event = std::get_if<T>(&record.event)) out.emplace_back(record.time, *event);
    return out;
  }

  testing_support::ScratchFolder scratch;

 private:
  int servers_ = 0;
  // The recorder notes when it begins; another time is written instead.
  static void shift(const Parts& parts, std::int64_t began);
};

void MergedTest::shift(const Parts& parts, std::int64_t began) {
  std::vector<Record> records{{0, World()}};
  {
    auto reader = Reader::open(parts).value();
    World world = reader->world();
    world.began = recordedWorld().began + began;
    records[0].event = world;
    while (auto record = reader->next()) records.push_back(std::move(*record));
  }
  Encoder encoder;
  Bytes block;
  for (const Record& record : records) ASSERT_TRUE(encoder.put(record, block));
  const Bytes bytes = compress(block);
  std::ofstream(parts.front(), std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

TEST_F(MergedTest, GivesTheMembersOfAllAndEachEditOnce) {
  const Edited first{1, "ann", "one"}, second{2, "bob", "two"}, third{3, "ann", "three"};
  const Parts a = record(0, {{1 * kSecond, first}, {2 * kSecond, joined(7)}, {4 * kSecond, second}, {9 * kSecond, third}});
  // It hears of the third edit before the other does, by its own clock.
  const Parts b =
      record(3 * kSecond, {{1 * kSecond, joined(8)}, {1 * kSecond + 5, second}, {2 * kSecond, third}, {3 * kSecond, Left{8}}}, {first});
  for (const auto& recordings : {std::vector{a, b}, std::vector{b, a}}) {
    std::string damage;
    const auto records = all(recordings, &damage);
    EXPECT_EQ(damage, "");
    using Edits = std::vector<std::pair<std::int64_t, Edited>>;
    EXPECT_EQ(of<Edited>(records), (Edits{{1 * kSecond, first}, {4 * kSecond, second}, {5 * kSecond, third}}));
    const auto came = of<Joined>(records);
    ASSERT_EQ(came.size(), 2u);
    EXPECT_EQ(came[0], std::pair(2 * kSecond, joined(7)));
    EXPECT_EQ(came[1], std::pair(4 * kSecond, joined(8)));
    for (std::size_t k = 1; k < records.size(); ++k) EXPECT_GE(records[k].time, records[k - 1].time);
  }
}

TEST_F(MergedTest, HasOneClockAndEndsTheMembersOfAServerThatEnded) {
  const Clocked begins{}, owned{wire::ClockMode::kScaled, 2, 5, 7, 0}, stepped{wire::ClockMode::kStepped, 0, 9, 8, 3};
  const Parts a = record(0, {{0, begins}, {1 * kSecond, joined(7)}, {2 * kSecond, owned}});
  const Parts b = record(kSecond, {{0, begins}, {1 * kSecond + 3, owned}, {2 * kSecond, joined(8)}, {3 * kSecond, stepped}});
  const auto records = all({a, b});
  const auto clocks = of<Clocked>(records);
  ASSERT_EQ(clocks.size(), 4u);
  EXPECT_EQ(clocks[0], std::pair(std::int64_t{0}, begins));
  EXPECT_EQ(clocks[1], std::pair(2 * kSecond, owned));
  EXPECT_EQ(clocks[2], std::pair(2 * kSecond + 3, owned)) << "the first has ended";
  EXPECT_EQ(clocks[3], std::pair(4 * kSecond, stepped));
  const auto left = of<Left>(records);
  ASSERT_GE(left.size(), 1u);
  EXPECT_EQ(left[0], std::pair(2 * kSecond, Left{7}));
}

TEST_F(MergedTest, RefusesWhatIsNotOfOneSession) {
  const Parts a = record(0, {{kSecond, Edited{1, "ann", "one"}}, {2 * kSecond, joined(7)}, {9 * kSecond, Left{7}}});
  World other = recordedWorld();
  ++other.seed;
  EXPECT_THAT(openRecords({a, record(0, {{0, joined(1)}}, {}, other)}).error().message, HasSubstr("different sessions or worlds"));
  std::string damage;
  all({a, record(0, {{3 * kSecond, Edited{1, "ann", "another"}}})}, &damage);
  EXPECT_THAT(damage, HasSubstr("At 3 s: Edit 1 is another one in '"));
  all({a, record(0, {{3 * kSecond, joined(7)}})}, &damage);
  EXPECT_THAT(damage, HasSubstr("At 3 s: Camera 7 is in '"));
  all({a, record(0, {{kSecond, joined(8)}, {3 * kSecond, Edited{1, "ann", "one"}}, {3 * kSecond, Edited{3, "ann", "three"}}})}, &damage);
  EXPECT_THAT(damage, HasSubstr("Edit 3 follows edit 1"));
  EXPECT_THAT(openRecords({a, {scratch / "none.0001.recording"}}).error().message, HasSubstr("Cannot read"));
}

}  // namespace
}  // namespace ridgecast::recording
