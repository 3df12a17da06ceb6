// Files that are damaged, old, cut off or no log at all: a sentence, never a crash, and never another ground without a word.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <fstream>
#include <random>

#include "tests/support/process.h"
#include "tests/support/sanitized.h"
#include "tests/unit/server/edit_log/session.h"

namespace ridgecast::edit_log {
namespace {

using testing::HasSubstr;
using testing_support::readText;
using testing_support::ScratchFolder;

void write(const std::filesystem::path& file, const std::string& bytes) { std::ofstream(file, std::ios::binary) << bytes; }

void change(const std::filesystem::path& file, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(file.c_str(), &database), SQLITE_OK);
  char* wrong = nullptr;
  EXPECT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, &wrong), SQLITE_OK) << wrong;
  EXPECT_GT(sqlite3_total_changes(database) + static_cast<int>(sql.starts_with("PRAGMA")), 0) << sql;
  sqlite3_close(database);
}

// Forty edits, whose layer's hash it returns.
std::uint64_t make(const std::filesystem::path& file) {
  std::mt19937_64 random(11);
  Session session = Session::open(file).value();
  for (int k = 0; k < 10; ++k) (void)session.append(4, random).value();
  return session.history.layer()->hash();
}

TEST(DamagedLogs, ThatAreNoLogsStayAsTheyAre) {
  const ScratchFolder folder;
  const std::filesystem::path file = folder / "a.edits";
  std::string text;
  for (int k = 0; k < 999; ++k) text += "This is no database. ";
  for (const std::string& bytes : {text, std::string("x")}) {
    write(file, bytes);
    EXPECT_EQ(Log::open(file).error().message, "'a.edits' is not a log of edits.") << bytes.size();
    EXPECT_TRUE(readText(file) == bytes);
  }
  std::filesystem::remove(file);
  change(file, "CREATE TABLE other(x); INSERT INTO other VALUES(1)");
  const std::string bytes = readText(file);
  EXPECT_THAT(Log::open(file).error().message, HasSubstr("is not a log of edits"));
  EXPECT_TRUE(readText(file) == bytes);
}

TEST(DamagedLogs, OfAnotherVersionAreRefused) {
  const ScratchFolder folder;
  make(folder / "a.edits");
  change(folder / "a.edits", "PRAGMA user_version = 3");
  EXPECT_THAT(Log::open(folder / "a.edits").error().message, HasSubstr("of version 3; this program reads versions 1 to 2."));
}

TEST(DamagedLogs, TilesAreMadeAgain) {
  for (const char* damage : {"DELETE FROM tiles WHERE (i, j) = (SELECT i, j FROM tiles LIMIT 1)", "UPDATE tiles SET tile = x'0001'",
                             "UPDATE tiles SET hash = hash + 1", "UPDATE meta SET tiles_of = 39", "UPDATE meta SET tiles_hash = 5",
                             "DELETE FROM tiles", "UPDATE tiles SET i = i + 1000", "UPDATE meta SET tiles_of = 41"}) {
    const ScratchFolder folder;
    const std::uint64_t hash = make(folder / "a.edits");
    change(folder / "a.edits", damage);
    for (const bool isRepaired : {false, true}) {
      auto log = Log::open(folder / "a.edits").value();
      EXPECT_EQ(log->layer().has_value(), isRepaired) << damage;
      EXPECT_EQ(historyOf(*log, alpine()).value().layer()->hash(), hash) << damage;
    }
  }
}

TEST(DamagedLogs, EditsAreMissedOrTold) {
  const std::pair<const char*, const char*> damages[] = {
      {"UPDATE edits SET edit = CAST(edit || x'01' AS BLOB) WHERE number = 7", "edit 7 has another hash"},
      {"UPDATE edits SET x1 = x1 + 1 WHERE number = 7", "edit 7 has another hash"},
      {"UPDATE edits SET edit = x'', hash = 0 WHERE number = 7", "edit 7 has another hash"},
      {"UPDATE edits SET author = author || 'x' WHERE number = 7", "edit 7 has another hash"},
      {"DELETE FROM edits WHERE number = 7", "edit 7 is missing"},
      {"DELETE FROM edits WHERE number < 7", "begin with 7 instead of 1"},
      {"UPDATE meta SET compacted = 7", "begin with 1 instead of 8"},
      {"DELETE FROM meta", "of which world"},
      {"UPDATE meta SET parameters = '['", "of which world"},
      {"PRAGMA writable_schema = ON; DELETE FROM sqlite_schema WHERE name = 'edits'", "is damaged"}};
  for (const auto& [sql, sentence] : damages) {
    const ScratchFolder folder;
    make(folder / "a.edits");
    change(folder / "a.edits", sql);
    auto log = Log::open(folder / "a.edits");
    EXPECT_THAT(log ? (*log)->past((*log)->compacted(), (*log)->last()).error().message : log.error().message, HasSubstr(sentence)) << sql;
  }
}

// Whatever the file says after damage: a sentence, or exactly the edits that were made and their ground.
void expectSentenceOrTruth(const std::filesystem::path& file, std::uint64_t hash, const std::vector<Applied>& edits, int& refused) {
  auto log = Log::open(file);
  ASSERT_TRUE(!log || *log) << "there was something in it";
  if (log) {
    const auto read = (*log)->read(0, kAll);
    const auto layer = (*log)->layer();
    if (layer) {
      EXPECT_EQ((*layer)->hash(), hash);
    }
    if (read) {
      EXPECT_EQ(*read, edits);
    }
    if (read && layer) return;
    ++refused;
    EXPECT_GT((read ? layer.error() : read.error()).message.size(), 20u);
  } else {
    ++refused;
    EXPECT_GT(log.error().message.size(), 20u);
  }
}

class DamagedFiles : public testing::Test {
 protected:
  DamagedFiles() : hash(make(folder / "whole")), whole(readText(folder / "whole")) {
    edits = Log::open(folder / "whole").value()->read(0, kAll).value();
  }
  ScratchFolder folder;
  std::uint64_t hash;
  std::string whole;
  std::vector<Applied> edits;
  std::mt19937_64 random{12};
  int refused = 0;
};

TEST_F(DamagedFiles, CutOffAnywhere) {
  for (int round = 0; round < testing_support::rounds(200); ++round) {
    write(folder / "a.edits", whole.substr(0, 1 + random() % (whole.size() - 1)));
    expectSentenceOrTruth(folder / "a.edits", hash, edits, refused);
  }
  EXPECT_EQ(refused, testing_support::rounds(200));
}

TEST_F(DamagedFiles, ChangedAnywhere) {
  for (int round = 0; round < testing_support::rounds(400); ++round) {
    std::string bytes = whole;
    for (std::uint64_t k = 1 + random() % 8; k > 0; --k) {
      const std::size_t at = round % 2 ? random() % bytes.size() : random() % 4096;
      if (random() % 3)
        bytes[at] = static_cast<char>(random());
      else
        for (std::size_t n = 0; n < 512 && at + n < bytes.size(); ++n) bytes[at + n] = static_cast<char>(random());
    }
    write(folder / "a.edits", bytes);
    expectSentenceOrTruth(folder / "a.edits", hash, edits, refused);
    if (HasFailure()) break;
  }
  EXPECT_GT(refused, testing_support::rounds(200));
}

}  // namespace
}  // namespace ridgecast::edit_log
