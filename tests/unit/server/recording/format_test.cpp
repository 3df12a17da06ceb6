#include "server/recording/format.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "server/recording/reader.h"
#include "tests/support/recorded_events.h"

namespace ridgecast::recording {
namespace {

using testing_support::recordedEvents;

std::string asText(const Bytes& bytes) { return {bytes.begin(), bytes.end()}; }

// A part with so many records in each frame, and where the frames end.
std::string partOf(const std::vector<Record>& records, std::size_t perFrame, std::vector<std::size_t>* ends = nullptr) {
  Encoder encoder;
  std::string out;
  for (std::size_t k = 0; k < records.size();) {
    Bytes block;
    for (std::size_t n = 0; n < perFrame && k < records.size(); ++n) EXPECT_TRUE(encoder.put(records[k++], block));
    out += asText(compress(block));
    if (ends) ends->push_back(out.size());
  }
  return out;
}

struct Content {
  std::vector<Record> records;
  bool wasCutOff = false, isWhole = false;
};
Content read(const std::string& part) {
  std::istringstream in(part);
  Blocks blocks(in);
  Decoder decoder;
  Content content;
  while (auto block = blocks.next())
    while (!block->empty()) {
      auto record = decoder.next(*block);
      if (!record) return content;
      content.records.push_back(std::move(*record));
    }
  content.wasCutOff = blocks.wasCutOff();
  content.isWhole = blocks.problem().empty();
  return content;
}

TEST(RecordingFormat, GivesBackEveryRecord) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5})
    for (const std::size_t perFrame : {1, 7, 100'000}) {
      const auto records = recordedEvents(seed, 2000);
      const Content content = read(partOf(records, perFrame));
      ASSERT_EQ(content.records.size(), records.size());
      for (std::size_t k = 0; k < records.size(); ++k) ASSERT_EQ(content.records[k], records[k]) << seed << ", record " << k;
      EXPECT_TRUE(content.isWhole);
    }
}

TEST(RecordingFormat, CutOffAnywhereHasTheWholeRecordsBefore) {
  const auto records = recordedEvents(6, 150);
  std::vector<std::size_t> ends;
  const std::string part = partOf(records, 3, &ends);
  for (std::size_t size = 0; size < part.size(); ++size) {
    const Content content = read(part.substr(0, size));
    const auto frames = static_cast<std::size_t>(std::upper_bound(ends.begin(), ends.end(), size) - ends.begin());
    ASSERT_EQ(content.records.size(), 3 * frames) << size;
    for (std::size_t k = 0; k < content.records.size(); ++k) ASSERT_EQ(content.records[k], records[k]);
    EXPECT_EQ(content.wasCutOff, size != (frames == 0 ? 0 : ends[frames - 1])) << size;
  }
}

// A flipped bit is found by the frame's checksum: what is read before it is right.
TEST(RecordingFormat, DamageEndsItAndChangesNothing) {
  const auto records = recordedEvents(7, 300);
  const std::string part = partOf(records, 10);
  std::mt19937_64 random(8);
  for (int round = 0; round < 500; ++round) {
    std::string bad = part;
    bad[random() % bad.size()] ^= static_cast<char>(1 << random() % 8);
    const Content content = read(bad);
    EXPECT_LE(content.records.size(), records.size());
    for (std::size_t k = 0; k < content.records.size(); ++k) ASSERT_EQ(content.records[k], records[k]);
  }
}

// Content that no encoder makes, in frames that are sound.
TEST(RecordingFormat, HostileContentIsRefused) {
  const auto records = recordedEvents(9, 200);
  Encoder encoder;
  Bytes whole;
  for (const Record& r : records) encoder.put(r, whole);
  std::mt19937_64 random(10);
  std::size_t refused = 0;
  for (int round = 0; round < 5000; ++round) {
    Bytes bad = whole;
    for (std::uint64_t n = 1 + random() % 3; n > 0; --n) bad[random() % bad.size()] = static_cast<std::uint8_t>(random());
    std::span<const std::uint8_t> block = bad;
    Decoder decoder;
    while (!block.empty()) {
      const auto record = decoder.next(block);
      if (!record) {
        EXPECT_FALSE(record.error().message.empty());
        ++refused;
        break;
      }
      if (const auto* i = std::get_if<Iterated>(&record->event)) {
        ASSERT_TRUE(camera::isValid(i->view));
      }
    }
  }
  EXPECT_GT(refused, 1000u);
  // A list that claims more than there is, and a frame that claims 1 GiB.
  const Bytes claims{14, 3, 0, 1, 16, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f, 0, 0};
  std::span<const std::uint8_t> block = claims;
  EXPECT_FALSE(Decoder().next(block));
  const Bytes bomb = compress(Bytes(kMaxBlockBytes + 1));
  EXPECT_FALSE(read(asText(bomb)).isWhole);
}

TEST(RecordingFormat, AFlightTakesFewBytes) {
  Encoder encoder;
  Bytes block;
  ASSERT_TRUE(encoder.put({0, Joined{1, "", {}, {}, {}, 0}}, block));
  block.clear();
  Iterated i{1};
  std::mt19937_64 random(11);
  for (int k = 0; k < 1000; ++k) {  // 50 m/s along a curve, ten times a second, by a clock that is not exact
    const double t = k * 0.1;
    i.view.pose.x = static_cast<lattice::Step>(12'800 * t + 900 * std::sin(t));
    i.view.pose.z = static_cast<lattice::Step>(3000 * std::cos(t / 7));
    i.view.pose.y = 300 + 40 * std::sin(t / 3);
    i.view.pose.yaw = std::sin(t / 5);
    i.view.pose.pitch = -0.2 + 0.01 * std::cos(t);
    ++i.pose;
    i.hash = random();
    encoder.put({k * 100'000 + static_cast<std::int64_t>(random() % 3000), i}, block);
  }
  EXPECT_LT(compress(block).size() / 1000, 50u);
}

TEST(RecordingFormat, WhatNobodyKnowsIsNotWritten) {
  Encoder encoder;
  Bytes out;
  EXPECT_FALSE(encoder.put({0, Iterated{3}}, out));
  EXPECT_FALSE(encoder.put({0, Left{3}}, out));
  EXPECT_FALSE(encoder.put({0, Edited{1, "", std::string(kMaxRecordBytes, 'x')}}, out));
  EXPECT_TRUE(out.empty());
}

TEST(RecordingFormat, PartsHaveNames) {
  EXPECT_EQ(partName("default.x", 12), "default.x.0012.recording");
  EXPECT_EQ(nameOf("/a/default.x.0012.recording"), (std::pair<std::string, unsigned>("default.x", 12)));
  EXPECT_EQ(nameOf("a.0000.recording"), (std::pair<std::string, unsigned>("a", kEditsPart)));
  for (const char* other : {"a.recording", "a.-1.recording", "a.1.edits", ".0001.recording", "a.1x.recording"})
    EXPECT_FALSE(nameOf(other)) << other;
}

}  // namespace
}  // namespace ridgecast::recording
