#include "server/recording/recorder.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "server/logging/logging.h"
#include "server/recording/reader.h"
#include "tests/support/process.h"
#include "tests/support/recorded_events.h"
#include "tests/support/sanitized.h"
#include "tests/support/waiting.h"

namespace ridgecast::recording {
namespace {

namespace fs = std::filesystem;
using testing_support::recordedEvents;
using testing_support::recordedWorld;
using testing_support::ScratchFolder;

class RecorderTest : public testing::Test {
 protected:
  void SetUp() override {
    logging::setUp(logging::Format::kText, logging::Level::kOff);
    fs::create_directory(folder);
  }
  void note(Observer& observer, const Record& record) { observer.note(start + std::chrono::microseconds(record.time), record.event); }
  static void waitFor(const Recorder& recorder) {  // it writes at once what is beyond a quarter of what may wait
    EXPECT_TRUE(testing_support::await([&] { return recorder.usage().waitingBytes < Recorder::kMaxWaiting / 2; }));
  }
  std::vector<std::vector<fs::path>> recordings() const { return recordingsAt(folder).value(); }
  // Of all parts at one time, while they come and go: until two listings agree.
  std::uint64_t bytes() const {
    std::map<fs::path, std::uintmax_t> last, now;
    do {
      last = std::exchange(now, {});
      std::error_code gone;
      for (const auto& entry : fs::directory_iterator(folder))
        if (const auto size = entry.file_size(gone); !gone) now[entry.path()] = size;
    } while (now != last);
    std::uint64_t sum = 0;
    for (const auto& [path, size] : now) sum += size;
    return sum;
  }
  std::string noise(std::size_t size) {  // which does not compress
    std::string out(size, ' ');
    for (char& c : out) c = static_cast<char>(random());
    return out;
  }
  static std::vector<Record> all(std::vector<fs::path> parts, std::string* damage = nullptr) {
    auto reader = Reader::open(std::move(parts)).value();
    std::vector<Record> out;
    while (auto record = reader->next()) out.push_back(std::move(*record));
    if (damage) *damage = reader->damage();
    return out;
  }

  ScratchFolder scratch;
  fs::path folder = scratch / "recordings";
  std::mt19937_64 random{5};
  const Observer::Instant start = Observer::Instant::clock::now();
};

TEST_F(RecorderTest, WritesWhatItIsTold) {
  const auto records = recordedEvents(1, 3000);
  {
    const auto recorder = Recorder::open(folder, 1 << 24).value();
    const auto observer = recorder->begin(recordedWorld(), {{1, "bob", "before"}}, start);
    for (std::size_t k = 1; k < records.size(); ++k) note(*observer, records[k]);
  }
  const auto read = all(recordings().at(0));
  ASSERT_EQ(read.size(), records.size());  // one edit more, and the world is taken off
  EXPECT_EQ(std::get<Edited>(read[0].event), (Edited{1, "bob", "before"}));
  EXPECT_EQ(std::vector(read.begin() + 1, read.end()), std::vector(records.begin() + 1, records.end()));
}

TEST_F(RecorderTest, PartsContinueEachOtherAndEachStandsAlone) {
  const auto records = recordedEvents(2, testing_support::kSanitized ? 100'000 : 200'000);
  {
    const auto recorder = Recorder::open(folder, 16 << 20).value();  // parts of 1 MiB
    const auto observer = recorder->begin(recordedWorld(), {}, start);
    std::size_t told = 0;
    for (std::size_t k = 1; k < records.size(); ++k) {
      note(*observer, records[k]);
      if (++told % 2000 == 0) waitFor(*recorder);
    }
  }
  const auto parts = recordings().at(0);
  ASSERT_GT(parts.size(), 2u);
  std::string damage;
  const auto read = all(parts, &damage);
  EXPECT_EQ(damage, "");
  EXPECT_EQ(read, std::vector(records.begin() + 1, records.end()));
  // From the second part on: all edits are there, members are there again, and iterations are the same.
  const auto later = all({parts.begin() + 1, parts.end()});
  std::uint64_t edits = 0;
  std::set<std::uint64_t> again;
  std::vector<Iterated> iterated, expected;
  for (const Record& r : later) {
    if (const auto* e = std::get_if<Edited>(&r.event)) {
      EXPECT_EQ(e->number, ++edits);
    }
    if (const auto* j = std::get_if<Joined>(&r.event); j && j->again) again.insert(j->camera);
    if (const auto* i = std::get_if<Iterated>(&r.event)) iterated.push_back(*i);
  }
  EXPECT_GT(again.size(), 1u);
  for (const Record& r : records)
    if (const auto* i = std::get_if<Iterated>(&r.event)) expected.push_back(*i);
  ASSERT_LT(iterated.size(), expected.size());
  EXPECT_TRUE(std::equal(iterated.rbegin(), iterated.rend(), expected.rbegin()));
}

// A crash leaves it empty, or with a piece of its first block.
TEST_F(RecorderTest, ALastPartThatWasOnlyBegunIsNoDamage) {
  const auto records = recordedEvents(4, 2000);
  {
    const auto recorder = Recorder::open(folder, 16 << 20).value();
    const auto observer = recorder->begin(recordedWorld(), {}, start);
    for (std::size_t k = 1; k < records.size(); ++k) note(*observer, records[k]);
  }
  const fs::path first = recordings().at(0).at(0), second = folder / partName(nameOf(first)->first, 2);
  const auto expected = all({first});
  fs::copy_file(first, second);
  for (const std::uintmax_t size : {fs::file_size(first) - 1, std::uintmax_t{1000}, std::uintmax_t{1}, std::uintmax_t{0}}) {
    fs::resize_file(second, size);
    auto reader = Reader::open({first, second}).value();
    std::vector<Record> read;
    while (auto record = reader->next()) read.push_back(std::move(*record));
    EXPECT_EQ(read, expected) << size;
    EXPECT_EQ(reader->damage(), "") << size;
    EXPECT_TRUE(reader->wasCutOff()) << size;
  }
  // Before another part, or with something else in it, it is damaged.
  std::string damage;
  all({first, second, first}, &damage);
  EXPECT_NE(damage.find("does not continue"), std::string::npos) << damage;
  std::ofstream(second) << "something else";
  all({first, second}, &damage);
  EXPECT_NE(damage.find("does not continue"), std::string::npos) << damage;
}

TEST_F(RecorderTest, TheOldestPartsGo) {
  std::ofstream(folder / "old.0001.recording") << std::string(900'000, 'x');
  const auto records = recordedEvents(3, 100'000);
  constexpr std::uint64_t kBytes = 1 << 20;
  {
    const auto recorder = Recorder::open(folder, kBytes).value();
    const auto observer = recorder->begin(recordedWorld(), {}, start);
    std::size_t told = 0;
    for (std::size_t k = 1; k < records.size(); ++k) {
      if (std::holds_alternative<Edited>(records[k].event)) continue;  // which would fill it
      note(*observer, records[k]);
      if (++told % 2000 == 0) {
        waitFor(*recorder);
        EXPECT_LE(bytes(), kBytes);
      }
    }
  }
  EXPECT_LE(bytes(), kBytes);
  EXPECT_GT(bytes(), kBytes / 2);
  EXPECT_FALSE(fs::exists(folder / "old.0001.recording"));
  const auto parts = recordings().at(0);
  EXPECT_GT(nameOf(parts.front())->second, 1u);
  EXPECT_EQ(all(parts).back(), records.back());
}

TEST_F(RecorderTest, WhatCannotBeKeptEndsTheRecordingAlone) {
  {
    const auto recorder = Recorder::open(folder, Recorder::kMinBytes).value();
    const auto lost = recorder->begin(recordedWorld(), {}, start);
    fs::remove_all(folder);
    lost->note(start, Joined{1, "", {}, {}, {}, 0});
  }
  EXPECT_FALSE(fs::exists(folder));
  {
    const auto recorder = Recorder::open(folder, Recorder::kMinBytes).value();
    World other = recordedWorld();
    other.session = "other";
    const auto big = recorder->begin(other, {}, start);
    for (std::uint64_t n = 1; n <= 12; ++n) big->note(start, Edited{n, "", noise(Recorder::kMinBytes / 16)});  // half of the room is 8
    const auto good = recorder->begin(recordedWorld(), {}, start);
    good->note(start, Joined{2, "", {}, {}, {}, 0});
  }
  const auto found = recordings();
  ASSERT_EQ(found.size(), 2u);
  EXPECT_GT(all(found[0]).size(), 5u);
  EXPECT_LT(all(found[0]).size(), 9u);
  EXPECT_EQ(all(found[1]).size(), 1u);
}

// They once began part after part, without end, and deleted all other recordings.
TEST_F(RecorderTest, KeptEditsThatHaveNoRoomEndTheRecordingAtOnce) {
  std::ofstream(folder / "old.0001.recording") << std::string(300'000, 'x');
  constexpr std::size_t kPart = Recorder::kMinBytes / 16;
  World big = recordedWorld(), named = recordedWorld(), fits = recordedWorld();
  big.session = "big", named.session = "named", fits.session = "fits";
  {
    const auto recorder = Recorder::open(folder, Recorder::kMinBytes).value();
    std::vector<Edited> large, byNames;
    for (std::uint64_t n = 1; n <= 12; ++n) large.push_back({n, "", noise(kPart)});
    for (std::uint64_t n = 1; n <= 12 * kPart / 64; ++n) byNames.push_back({n, noise(64), ""});
    const std::vector<std::shared_ptr<Observer>> observers{recorder->begin(big, large, start), recorder->begin(named, byNames, start),
                                                           recorder->begin(fits, {{1, "", noise(kPart / 4)}}, start)};
    for (const auto& observer : observers) observer->note(start, Joined{1, "", {}, {}, {}, 0});
    EXPECT_TRUE(testing_support::await([&] { return recorder->usage().failed == 2 && recorder->usage().keptBytes == bytes(); }));
  }
  const auto found = recordings();
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(nameOf(found[0].at(0))->first.substr(0, 5), "fits.");
  EXPECT_EQ(all(found[0]).size(), 2u);
  EXPECT_EQ(found[1].at(0), folder / "old.0001.recording");
}

TEST_F(RecorderTest, AFloodEndsTheRecordingInsteadOfWaiting) {
  constexpr std::size_t kEdit = Recorder::kMaxWaiting / 8;
  {
    const auto recorder = Recorder::open(folder, 1 << 30).value();
    const auto observer = recorder->begin(recordedWorld(), {}, start);
    const std::string edit = noise(kEdit);
    for (std::uint64_t n = 1; n <= 100; ++n) observer->note(start, Edited{n, "", edit});
    EXPECT_EQ(recorder->usage().failed, 1u);
  }
  const auto read = all(recordings().at(0));
  EXPECT_GE(read.size(), 7u) << "what may wait is written";
  for (std::size_t k = 0; k < read.size(); ++k) EXPECT_EQ(std::get<Edited>(read[k].event).number, k + 1);  // and nothing after a gap
}

// 24 edits in 0.6 s once ended the recording for good, as every part repeated them.
TEST_F(RecorderTest, EditsAreKeptOnceBesideTheParts) {
  constexpr std::uint64_t kBytes = 16 << 20, kEdits = 24;
  constexpr std::size_t kEdit = 256 << 10;  // a quarter of a part
  std::vector<Edited> edits;
  for (std::uint64_t n = 1; n <= kEdits; ++n) edits.push_back({n, "ann", noise(kEdit)});
  {
    const auto recorder = Recorder::open(folder, kBytes).value();
    const auto observer = recorder->begin(recordedWorld(), {edits.begin(), edits.begin() + 8}, start);
    for (auto edit = edits.begin() + 8; edit != edits.end(); ++edit) observer->note(start, *edit), waitFor(*recorder);
    observer->note(start, Joined{1, "", {}, {}, {}, kEdits});
  }
  const auto parts = recordings().at(0);
  EXPECT_GT(parts.size(), 3u);
  EXPECT_LE(bytes(), (kEdits + kEdits - 8 + 1) * kEdit) << "once beside the parts, once where they were made";
  for (const std::size_t from : {std::size_t{0}, parts.size() / 2, parts.size() - 1}) {
    std::string damage;
    const auto read = all({parts.begin() + static_cast<std::ptrdiff_t>(from), parts.end()}, &damage);
    EXPECT_EQ(damage, "");
    ASSERT_EQ(read.size(), kEdits + 1) << from;
    for (std::size_t k = 0; k < kEdits; ++k) EXPECT_EQ(std::get<Edited>(read[k].event), edits[k]) << k;
    EXPECT_TRUE(std::holds_alternative<Joined>(read.back().event));
  }
  // A part is missing between: its edits are there all the same.
  const auto rest = all({parts.front(), parts.back()});
  ASSERT_EQ(rest.size(), kEdits + 1);
  for (std::size_t k = 0; k < kEdits; ++k) EXPECT_EQ(std::get<Edited>(rest[k].event), edits[k]) << k;
  const fs::path kept = folder / partName(nameOf(parts[0])->first, kEditsPart);
  const auto size = fs::file_size(kept);
  for (const std::uintmax_t left : {size - 1, size / 2, std::uintmax_t{100}, std::uintmax_t{0}}) {
    fs::resize_file(kept, left);
    std::string damage;
    const auto read = all({parts.back()}, &damage);
    EXPECT_NE(damage.find("'" + kept.string() + "' belongs beside it."), std::string::npos) << left;
    EXPECT_LT(read.size(), kEdits);
    for (std::size_t k = 0; k < read.size(); ++k) EXPECT_EQ(std::get<Edited>(read[k].event), edits[k]);
  }
  fs::remove(kept);
  std::string damage;
  EXPECT_TRUE(all({parts.back()}, &damage).empty());
  EXPECT_NE(damage.find("belongs beside it"), std::string::npos);
}

// They are the last to go, also when a later run makes the room.
TEST_F(RecorderTest, EditsGoAfterThePartsThatNeedThem) {
  {
    const auto recorder = Recorder::open(folder, Recorder::kMinBytes).value();
    const auto observer = recorder->begin(recordedWorld(), {{1, "", noise(1000)}}, start);
    for (std::uint64_t n = 2; n <= 4; ++n) observer->note(start, Edited{n, "", noise(Recorder::kMinBytes / 8)});
  }
  const auto parts = recordings().at(0);
  ASSERT_GT(parts.size(), 1u);
  const fs::path kept = folder / partName(nameOf(parts[0])->first, kEditsPart);
  const auto later = fs::last_write_time(parts.back());
  fs::last_write_time(kept, later - std::chrono::hours(1));  // it was not written again
  World other = recordedWorld();
  other.session = "other";
  const auto recorder = Recorder::open(folder, Recorder::kMinBytes).value();
  const auto observer = recorder->begin(other, {}, start);
  constexpr std::size_t kBlock = 264 << 10;  // written at once
  for (std::uint64_t k = 1; k <= 4 && fs::exists(kept); ++k) {
    observer->note(start, Asked{1, 0, noise(kBlock)});
    EXPECT_TRUE(testing_support::await([&] { return recorder->usage().bytes >= k * kBlock; }));
  }
  EXPECT_FALSE(fs::exists(kept));
  for (const fs::path& part : parts) EXPECT_FALSE(fs::exists(part)) << "which needs them";
}

// It would delete the parts that the first one writes.
TEST_F(RecorderTest, AFolderTakesOneRecorderAtATime) {
  auto first = Recorder::open(folder, 1 << 20).value();
  const auto second = Recorder::open(folder, 1 << 20);
  ASSERT_FALSE(second);
  EXPECT_NE(second.error().message.find("is in use by another program"), std::string::npos);
  first.reset();
  EXPECT_TRUE(Recorder::open(folder, 1 << 20));
}

TEST_F(RecorderTest, WhatIsNoRecordingIsRefused) {
  EXPECT_FALSE(recordingsAt(folder));
  EXPECT_FALSE(recordingsAt(folder / "nothing"));
  std::ofstream(folder / "a.0001.recording") << "something else";
  EXPECT_NE(Reader::open(recordings().at(0)).error().message.find("is not a recording"), std::string::npos);
  EXPECT_FALSE(Recorder::open(folder / "a.0001.recording", 1 << 20));
}

}  // namespace
}  // namespace ridgecast::recording
