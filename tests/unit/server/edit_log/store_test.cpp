// The laws of a store of edits, for each implementation and each way to open it.
#include "server/edit_store/store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "common/edits/json.h"
#include "server/edit_log/log.h"
#include "tests/support/process.h"
#include "tests/unit/server/edit_log/session.h"

namespace ridgecast::edit_log {
namespace {

using edit_store::Store;
using testing::HasSubstr;
using testing_support::m;
using testing_support::ScratchFolder;

const edits::Layer kEmpty;
const Change kNoChange{kEmpty, kEmpty, {}};

edits::Operation raise(double x) { return {edits::Raise{{m(x), 0}, m(5), 0, m(2)}, 0}; }
// So many bytes of operation, about.
edits::Operation stamp(std::uint32_t side, std::mt19937_64& random) {
  edits::Stamp out{{0, 0}, side, side, 1, {}};
  for (std::uint32_t k = 0; k < side * side; ++k) out.samples.push_back(static_cast<std::int32_t>(random() % 1000));
  return {std::move(out), 0};
}

struct Opening {
  const char* name;
  bool isFile, opensAgain;  // before each look
};

class Stores : public testing::TestWithParam<Opening> {
 protected:
  void SetUp() override {
    if (GetParam().isFile)
      store_ = Log::create(folder_ / "a.edits", worldOf(*alpine())).value();
    else
      store_ = Log::temporary().value();
  }
  Store& store() {
    if (GetParam().opensAgain) {
      store_.reset();
      store_ = Log::open(folder_ / "a.edits").value();
    }
    return *store_;
  }

 private:
  ScratchFolder folder_;
  std::unique_ptr<Store> store_;
};

TEST_P(Stores, KeepWhatWasAppendedAsItWasInItsOrder) {
  std::mt19937_64 random(1);
  std::vector<Applied> all;
  std::size_t bytes = 0;
  EXPECT_TRUE(store().read(0, kAll).value().empty());
  for (int group = 0; group < 20; ++group) {
    std::vector<Applied> some;
    for (std::uint64_t k = 1 + random() % 5; k > 0; --k) {
      const std::uint64_t number = all.size() + some.size() + 1;
      Applied edit =
          applied(number, random() % 2 ? "a\nkey " + std::to_string(number) : "", testing_support::randomOperation(random, {0, 0}));
      edit.author = std::string("token of x\nann\0\xff", 17);
      edit.time = static_cast<std::int64_t>(random());
      edit.ground = {-m(1e9), static_cast<lattice::Step>(number), m(1e9), 0};
      some.push_back(std::move(edit));
    }
    ASSERT_TRUE(store().append(some, kNoChange));
    for (const Applied& e : some) bytes += e.bytes();
    all.insert(all.end(), some.begin(), some.end());
    EXPECT_EQ(store().last(), all.size());
    EXPECT_EQ(store().bytes(), bytes);
    EXPECT_EQ(store().compacted(), 0u);
  }
  EXPECT_EQ(store().read(0, kAll).value(), all);
  for (const Applied& e : all) {
    EXPECT_EQ(store().read(e.number - 1, 0).value(), std::vector{e});
    if (!e.key.empty()) {
      EXPECT_EQ(store().numberOf(e.key).value(), e.number);
    }
  }
  EXPECT_TRUE(store().read(all.size(), kAll).value().empty());
  EXPECT_TRUE(store().read(all.size() + 5, kAll).value().empty());
}

TEST_P(Stores, TakeOnlyWhatFollowsAndAllOrNothing) {
  ASSERT_TRUE(store().append({}, kNoChange));
  const std::vector first{applied(1, "a", raise(0)), applied(2, "", raise(1))};
  EXPECT_THAT(store().append(std::vector{applied(2, "", raise(0))}, kNoChange).error().message, HasSubstr("does not follow edit 0"));
  ASSERT_TRUE(store().append(first, kNoChange));
  const std::vector<std::pair<std::vector<Applied>, const char*>> wrong{
      {first, "Edit 1 does not follow edit 2"},
      {{applied(4, "", raise(0))}, "Edit 4 does not follow edit 2"},
      {{applied(3, "", raise(0)), applied(5, "", raise(0))}, "Edit 5 does not follow edit 3"},
      {{applied(3, "b", raise(0)), applied(4, "a", raise(0))}, "number or key already"},
      {{applied(3, "b", raise(0)), applied(4, "b", raise(0))}, "number or key already"}};
  for (const auto& [edits, sentence] : wrong) {
    EXPECT_THAT(store().append(edits, kNoChange).error().message, HasSubstr(sentence));
    EXPECT_EQ(store().last(), 2u);
    EXPECT_EQ(store().bytes(), first[0].bytes() + first[1].bytes());
    EXPECT_EQ(store().read(0, kAll).value(), first);
    EXPECT_EQ(store().numberOf("b").value(), std::nullopt);
  }
  EXPECT_EQ(store().numberOf("").value(), std::nullopt);
  ASSERT_TRUE(store().append(std::vector{applied(3, "b", raise(0))}, kNoChange));
  EXPECT_EQ(store().numberOf("b").value(), 3u);
}

TEST_P(Stores, AreReadInPagesOfBytes) {
  std::mt19937_64 random(2);
  std::vector<Applied> all;
  for (std::uint64_t number = 1; number <= 60; ++number) all.push_back(applied(number, "", number % 7 == 0 ? stamp(40, random) : raise(0)));
  ASSERT_TRUE(store().append(all, kNoChange));
  for (const std::size_t most : {0ul, 1ul, 100ul, 3000ul, 100'000ul}) {
    std::vector<Applied> read;
    for (;;) {
      const auto page = store().read(read.size(), most).value();
      if (page.empty()) break;
      std::size_t bytes = 0;
      for (const Applied& e : page) bytes += e.bytes();
      EXPECT_TRUE(bytes <= most || page.size() == 1) << bytes;
      read.insert(read.end(), page.begin(), page.end());
      EXPECT_TRUE(read.size() == all.size() || bytes + all[read.size()].bytes() > most) << "more would have fitted";
    }
    EXPECT_EQ(read, all) << most;
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Stores,
                         testing::Values(Opening{"AFile", true, false}, Opening{"AFileOpenedAgain", true, true},
                                         Opening{"ATemporaryFile", false, false}),
                         [](const auto& one) { return std::string(one.param.name); });

// What a log of the first version, made by a server of then, says after it was opened. Its export then is beside it.
class FirstVersion : public testing::Test {
 protected:
  FirstVersion() {
    std::filesystem::copy_file(RIDGECAST_CASES "/edits/version_1.edits", file, std::filesystem::copy_options::overwrite_existing);
  }
  ScratchFolder folder;
  const std::filesystem::path file = folder / "a.edits";
};

TEST_F(FirstVersion, IsReadAsItWasAndStaysReadable) {
  for (const char* const opening : {"made new", "new"}) {
    const auto log = Log::open(file);
    ASSERT_TRUE(log) << opening << ": " << log.error().message;
    EXPECT_EQ((*log)->last(), 10u);
    EXPECT_TRUE((*log)->check());
    const auto edits = (*log)->read(0, kAll);
    ASSERT_TRUE(edits) << edits.error().message;
    std::string lines;
    std::uint64_t bytes = 0;
    for (const Applied& e : *edits) {
      lines += std::to_string(e.number) + " " + std::to_string(e.time % 100) + " " + edits::toJson(operationOf(e)) + "\n";
      bytes += e.bytes();
      const edits::Posts area = edits::areaOf(operationOf(e));
      EXPECT_EQ(e.ground, area.empty() ? edit_store::kEverywhere : edits::groundOf(area)) << "of an undo nobody knows";
    }
    EXPECT_EQ((*log)->bytes(), bytes);
    std::string expected;
    std::ifstream exported(RIDGECAST_CASES "/edits/version_1.jsonl");
    for (std::string line; std::getline(exported, line);) {
      const auto number = line.substr(10, line.find(',') - 10), edit = line.substr(line.find("\"edit\":") + 7);
      expected += number + " " + number + " " + edit.substr(0, edit.size() - 1) + "\n";
    }
    EXPECT_EQ(lines, expected);
    EXPECT_EQ(edits->at(0).author, "token of lab\nann");
    EXPECT_EQ((*log)->numberOf("token of lab\nann\nk1").value(), 1u);
    EXPECT_EQ((*log)->numberOf("\nbob\nk2").value(), 3u) << "whose client nobody knew";
    const auto cached = (*log)->layer();
    ASSERT_TRUE(cached) << cached.error().message;
    auto history = historyOf(**log, alpine());
    ASSERT_TRUE(history) << history.error().message;
    ASSERT_TRUE(history->replay());
    EXPECT_EQ(history->layer()->hash(), (*cached)->hash());
    EXPECT_EQ((*cached)->hash(), 0x6ca936765f9ede44u);
  }
}

TEST_F(FirstVersion, IsOpenedWholeOrStaysAsItIs) {
  const auto change = [&](const std::string& sql) {
    sqlite3* database = nullptr;
    ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(database);
  };
  change("UPDATE edits SET author = 'eve' WHERE number = 9");
  EXPECT_EQ(Log::open(file).error().message, "'a.edits' is damaged: edit 9 has another hash.");
  change("UPDATE edits SET author = 'ann' WHERE number = 9");
  EXPECT_EQ(Log::open(file).value()->read(0, kAll).value().size(), 10u) << "a part of it was changed";
}

}  // namespace
}  // namespace ridgecast::edit_log
