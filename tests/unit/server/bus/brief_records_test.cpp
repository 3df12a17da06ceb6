// What may be written at once is bounded, of a server and in the engine.
#include "server/bus/brief_records.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "tests/support/simulated_bus.h"
#include "tests/support/simulated_timer.h"

namespace ridgecast::bus {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing_support::SimulatedEngine;
using testing_support::SimulatedTimer;

constexpr std::size_t kShare = 1000, kMost = BriefRecords::kSharesOfOne * kShare;
constexpr std::size_t kServers = 40;  // so many that each fills its share slowly
constexpr std::string_view kKeys = "mesh/";

class BriefRecordsTest : public testing::Test {
 protected:
  struct Server {
    std::shared_ptr<Bus> bus;
    std::shared_ptr<BriefRecords> records = std::make_shared<BriefRecords>("test", kShare);
  };
  BriefRecordsTest() {
    for (std::size_t k = 0; k < kServers; ++k) servers.push_back({engine.connect()});
    timer.advance(0s);
  }
  using Said = std::shared_ptr<std::optional<Outcome<Bus::Held>>>;
  Said write(std::size_t server, std::size_t bytes) {
    const auto said = std::make_shared<std::optional<Outcome<Bus::Held>>>();
    const std::string key = std::string(kKeys) + std::to_string(1'000'000 + written++);
    Server& s = servers[server];
    s.records->hold(s.bus, key, std::string(bytes - key.size(), 'm'), timer.now(), [said](auto held) {
      EXPECT_FALSE(*said) << "answered twice";
      *said = std::move(held);
    });
    return said;
  }
  Said writeNow(std::size_t server, std::size_t bytes) {
    const auto said = write(server, bytes);
    timer.advance(0s);
    return said;
  }
  std::size_t bytesInEngine(std::chrono::seconds patience = 0s) {
    const auto bytes = std::make_shared<std::size_t>(0);
    servers[0].bus->list(std::string(kKeys), [bytes](const auto& records) {
      for (const auto& [key, record] : *records) *bytes += key.size() + record.value.size();
    });
    timer.advance(patience);
    return *bytes;
  }

  SimulatedTimer timer;
  SimulatedEngine engine{timer};
  std::vector<Server> servers;
  int written = 0;
};

TEST_F(BriefRecordsTest, OfOneServerAreBoundedInAMinute) {
  std::vector<Said> said;
  for (std::size_t k = 0; k < kMost / 100 + 2; ++k) said.push_back(write(0, 100));  // before a share is claimed
  ASSERT_TRUE(*said.back());
  EXPECT_THAT((**said.back()).error().message, HasSubstr("This server has written too many"));
  timer.advance(1s);
  for (std::size_t k = 0; k < kMost / 100; ++k) EXPECT_TRUE(*said[k] && **said[k] && (**said[k])->isYours) << k;
  EXPECT_EQ(bytesInEngine(), kMost);
  EXPECT_FALSE(**writeNow(0, 100));
  timer.advance(BriefRecords::kLife);
  EXPECT_TRUE(**writeNow(0, kShare)) << "those shares ended, and there are others";
  EXPECT_FALSE(**writeNow(0, kShare + 1));
}

TEST_F(BriefRecordsTest, OfAllServersHaveSomeShares) {
  for (std::size_t k = 0; k < BriefRecords::kShares; ++k) EXPECT_TRUE(**writeNow(k / BriefRecords::kSharesOfOne, kShare)) << k;
  const auto refused = writeNow(kServers - 1, 100);
  ASSERT_FALSE(**refused);
  EXPECT_THAT((**refused).error().message, HasSubstr("try again in a minute"));
  timer.advance(2 * BriefRecords::kLife + BriefRecords::kDelay);
  EXPECT_TRUE(**writeNow(kServers - 1, kShare));
}

// What is written late still lives when the share's first minute is over.
TEST_F(BriefRecordsTest, HaveAShareAsLongAsTheyLive) {
  for (std::size_t k = 0; k < BriefRecords::kShares; ++k) EXPECT_TRUE(**writeNow(k, 50)) << k;
  timer.advance(BriefRecords::kLife - 1s);
  for (std::size_t k = 0; k < BriefRecords::kShares; ++k) EXPECT_TRUE(**writeNow(k, kShare - 50)) << k;
  timer.advance(2s);
  EXPECT_FALSE(**writeNow(kServers - 1, 100));
  EXPECT_EQ(bytesInEngine(), BriefRecords::kShares * (kShare - 50));
  timer.advance(BriefRecords::kLife + BriefRecords::kDelay);
  EXPECT_EQ(bytesInEngine(), 0u);
  EXPECT_TRUE(**writeNow(kServers - 1, 100));
}

TEST_F(BriefRecordsTest, AreRefusedWhileTheEngineIsAwayAndWrittenAfter) {
  engine.stop();
  EXPECT_FALSE(**writeNow(0, 100));
  engine.start();
  timer.advance(1s);
  EXPECT_TRUE(**writeNow(0, 100));
}

TEST_F(BriefRecordsTest, InTheEngineAreBoundedWheneverServersWrite) {
  std::mt19937_64 random(1);
  engine.slow(20ms, 200ms);
  std::size_t most = 0;
  int accepted = 0, refused = 0;
  std::vector<Said> said;
  for (int k = 0; k < 6000; ++k) {
    said.push_back(write(random() % servers.size(), 50 + random() % 400));
    timer.advance(std::chrono::milliseconds(random() % 400));
    if (k % 20 == 0) most = std::max(most, bytesInEngine(2s));
  }
  timer.advance(5s);
  for (const Said& one : said) {
    ASSERT_TRUE(*one);
    **one ? ++accepted : ++refused;
  }
  EXPECT_LE(most, BriefRecords::kShares * kShare);
  EXPECT_GT(most, BriefRecords::kShares * kShare / 2) << "nothing was tried";
  EXPECT_GT(accepted, 100);
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace ridgecast::bus
