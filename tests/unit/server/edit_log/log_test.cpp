#include "server/edit_log/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <random>

#include "server/edit_log/tiles.h"
#include "tests/support/crater.h"
#include "tests/support/process.h"
#include "tests/unit/server/edit_log/session.h"

namespace ridgecast::edit_log {
namespace {

using testing::HasSubstr;
using testing_support::craterAt;
using testing_support::ScratchFolder;

const edits::Layer kNone;
const Change kNothing{kNone, kNone, {}};

TEST(Tiles, ComeBackAsTheyWere) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 2000; ++round) {
    edits::TilePosts tile;
    const int kind = round % 4;
    for (std::size_t k = 0; k < tile.rise.size(); ++k) {
      if (kind == 1) tile.rise[k] = static_cast<std::int32_t>(k * 3 % 100);
      if (kind == 2 && random() % 9 == 0) tile.rise[k] = random() % 2 ? edits::kMaxRise : -edits::kMaxRise;
      if (kind == 3) tile.rise[k] = static_cast<std::int32_t>(random() % (2 * edits::kMaxRise + 1)) - edits::kMaxRise;
      if (kind >= 2) tile.material[k] = static_cast<std::uint8_t>(random() % 9);
    }
    std::vector<std::uint8_t> bytes;
    encodeTile(tile, bytes);
    const auto back = decodeTile(bytes);
    ASSERT_TRUE(back);
    ASSERT_EQ(back->posts(), tile);
    ASSERT_EQ(*back, edits::Tile(tile));
    // Neither cut off nor continued is it a tile.
    EXPECT_FALSE(decodeTile({bytes.data(), random() % bytes.size()}));
    bytes.push_back(0);
    EXPECT_FALSE(decodeTile(bytes));
  }
}

TEST(Tiles, AreRefusedWhenTheyAreNone) {
  std::mt19937_64 random(2);
  int refused = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::vector<std::uint8_t> bytes(random() % 600);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random() % 4 == 0 ? random() : random() % 3);
    const auto tile = decodeTile(bytes);
    if (!tile) {
      ++refused;
      continue;
    }
    for (const std::int32_t rise : tile->posts().rise) ASSERT_LE(std::abs(rise), edits::kMaxRise);
    for (const std::uint8_t material : tile->posts().material) ASSERT_LE(material, edits::kMaterials);
  }
  EXPECT_GT(refused, 10'000);
}

TEST(Log, KeepsTheWorldThatItWasMadeFor) {
  const ScratchFolder folder;
  const World world{"canyon", 4'000'000'000, {{"depth", 0.1}, {"width", 1e300}}, 0xfedcba9876543210};
  { ASSERT_TRUE(Log::create(folder / "a.edits", world)); }
  const auto log = Log::open(folder / "a.edits").value();
  EXPECT_EQ(log->world(), world);
  EXPECT_EQ(log->last(), 0u);
  EXPECT_TRUE(log->layer().value()->empty());
  EXPECT_TRUE(log->read(0, kAll).value().empty());
}

// Another program, begun before this one opens anything: locks are a process's own, and SQLite knows which of them it has.
class Elsewhere {
 public:
  Elsewhere() {
    EXPECT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends_), 0);
    child_ = fork();
    if (child_ != 0) return;
    close(ends_[0]);
    char file[4096];
    for (ssize_t size = 0; (size = read(ends_[1], file, sizeof file)) > 0;) {
      const char answer = Log::open(std::string(file, static_cast<std::size_t>(size))) ? 1 : 0;
      if (write(ends_[1], &answer, 1) != 1) break;
    }
    _exit(0);
  }
  ~Elsewhere() {
    for (const int end : ends_) close(end);
    waitpid(child_, nullptr, 0);
  }
  Elsewhere(const Elsewhere&) = delete;
  Elsewhere& operator=(const Elsewhere&) = delete;

  bool opens(const std::filesystem::path& file) {
    char answer = 2;
    EXPECT_GT(write(ends_[0], file.c_str(), file.string().size()), 0);
    EXPECT_EQ(read(ends_[0], &answer, 1), 1);
    return answer == 1;
  }

 private:
  int ends_[2] = {-1, -1};
  pid_t child_ = -1;
};

TEST(Log, IsOpenOnceWhateverElseItsProgramOpens) {
  Elsewhere elsewhere;
  const ScratchFolder folder;
  for (const bool hasLockFile : {false, true}) {
    const std::filesystem::path state = folder / (hasLockFile ? "locked" : "plain"), file = state / "a.edits";
    std::filesystem::create_directory(state);
    if (hasLockFile) {
      ASSERT_TRUE(Lock::prepare(state));
    }
    {
      auto first = Log::create(file, {}).value();
      EXPECT_FALSE(elsewhere.opens(file));
      EXPECT_THAT(Log::open(file).error().message, HasSubstr("in use by another program"));
      EXPECT_FALSE(elsewhere.opens(file)) << "the second one here has lost the first one's locks";
      if (hasLockFile) {
        (void)testing_support::readText(file);  // which closes it, and SQLite's own locks go
        (void)testing_support::readText(state / Lock::kFile);
        EXPECT_FALSE(elsewhere.opens(file));
      }
      EXPECT_TRUE(first->append(std::vector{applied(1, "", craterAt(0))}, kNothing));
    }
    EXPECT_TRUE(elsewhere.opens(file));
    EXPECT_EQ(Log::open(file).value()->last(), 1u);
  }
}

TEST(Log, IsNewOrOpenedNeverBoth) {
  const ScratchFolder folder;
  const std::filesystem::path file = folder / "a.edits";
  EXPECT_FALSE(Log::open(file).value());
  EXPECT_FALSE(std::filesystem::exists(file));
  std::ofstream(file).close();  // as a making that was cut off leaves it
  EXPECT_FALSE(Log::open(file).value());
  ASSERT_TRUE(Log::create(file, worldOf(*alpine())).value()->append(std::vector{applied(1, "", craterAt(0))}, kNothing));
  EXPECT_THAT(Log::create(file, {}).error().message, HasSubstr("'a.edits' has edits already"));
  EXPECT_EQ(Log::open(file).value()->last(), 1u);
  EXPECT_EQ(Log::open(file).value()->world(), worldOf(*alpine()));
}

TEST(Log, IsReadByItsOwnerAlone) {
  const ScratchFolder folder;
  const std::filesystem::path state = folder / "new/state";
  ASSERT_TRUE(Lock::prepare(state));
  const auto log = Log::create(state / "a.edits", {}).value();
  ASSERT_TRUE(log->append(std::vector{applied(1, "", craterAt(0))}, kNothing));
  ASSERT_TRUE(log->backUp(state / "copy"));
  using std::filesystem::perms;
  const auto permissionsOf = [](const std::filesystem::path& file) { return std::filesystem::status(file).permissions(); };
  EXPECT_EQ(permissionsOf(state), perms::owner_all);
  int files = 0;
  for (const auto& file : std::filesystem::directory_iterator(state)) {
    EXPECT_EQ(permissionsOf(file), perms::owner_read | perms::owner_write) << file.path();
    ++files;
  }
  EXPECT_EQ(files, 4) << "log, journal, copy and lock file";
}

TEST(Lock, IsOfOneName) {
  Elsewhere elsewhere;
  const ScratchFolder folder;
  ASSERT_TRUE(Lock::prepare(folder / ""));
  const auto first = Lock::take(folder / "a.edits");
  ASSERT_TRUE(first);
  EXPECT_THAT(Lock::take(folder / "./a.edits").error().message, HasSubstr("'a.edits' is in use by another program"));
  EXPECT_FALSE(elsewhere.opens(folder / "a.edits")) << "before there is a log";
  std::vector<std::shared_ptr<const Lock>> others;
  for (int k = 0; k < 1000; ++k) {
    auto other = Lock::take(folder / (std::to_string(k) + ".edits"));
    ASSERT_TRUE(other) << k;
    others.push_back(std::move(*other));
  }
}

TEST(Lock, NeedsAFolderThatCanBeWritten) {
  const ScratchFolder folder;
  EXPECT_THAT(Lock::prepare("/proc").error().message, HasSubstr("--state '/proc' cannot be written: "));
  EXPECT_THAT(Lock::prepare("/dev/null").error().message, HasSubstr("is not a folder and cannot be created"));
}

TEST(Log, SaysWhyItCannotBeMade) {
  const ScratchFolder folder;
  EXPECT_THAT(Log::create(folder / "none" / "a.edits", {}).error().message, HasSubstr("check that its folder exists"));
}

TEST(Log, IsOfOneTerrain) {
  const ScratchFolder folder;
  auto log = openOrCreate(folder / "a.edits").value();
  const auto other = terrain::create("canyon", 7).value();
  const std::string refusal = historyOf(*log, other).error().message;
  EXPECT_THAT(refusal, HasSubstr("alpine"));
  EXPECT_THAT(refusal, HasSubstr("canyon"));
  EXPECT_TRUE(historyOf(*log, alpine()));
}

TEST(Log, IsBackedUpWhileItGrows) {
  const ScratchFolder folder;
  std::mt19937_64 random(5);
  Session session = Session::open(folder / "a.edits").value();
  for (int k = 0; k < 5; ++k) {
    ASSERT_TRUE(session.append(7, random));
    const std::filesystem::path to = folder / std::to_string(k);
    ASSERT_TRUE(session.log->backUp(to));
    EXPECT_THAT(session.log->backUp(to).error().message, HasSubstr("exists already"));
    auto copy = Log::open(to).value();
    EXPECT_TRUE(copy->check());
    EXPECT_EQ(copy->read(0, kAll).value(), session.log->read(0, kAll).value());
    EXPECT_EQ(copy->layer().value()->hash(), session.history.layer()->hash());
    EXPECT_FALSE(std::filesystem::exists(folder / (std::to_string(k) + ".new")));
  }
  EXPECT_FALSE(session.log->backUp(folder / "none" / "a"));
}

TEST(Log, CompactedEditsAreGroundAndNumbersGoOn) {
  const ScratchFolder folder;
  std::mt19937_64 random(6);
  std::vector<Applied> later;
  std::uint64_t hash = 0;
  {
    Session session = Session::open(folder / "a.edits").value();
    for (int k = 0; k < 10; ++k) ASSERT_TRUE(session.append(4, random));
    hash = session.history.layer()->hash();
    ASSERT_TRUE(session.log->compact());
    EXPECT_EQ(session.log->compacted(), 40u);
    EXPECT_EQ(session.log->last(), 40u);
    EXPECT_TRUE(session.log->read(0, kAll).value().empty());
  }
  {
    Session session = Session::open(folder / "a.edits").value();
    EXPECT_EQ(session.history.layer()->hash(), hash);
    EXPECT_EQ(session.history.last(), 40u);
    EXPECT_EQ(session.history.prepare({edits::Undo{17}, 0}).error().message, "Edit 17 was compacted and cannot be undone.");
    for (int k = 0; k < 10; ++k)
      for (const Applied& e : session.append(4, random).value()) later.push_back(e);
    EXPECT_EQ(later.front().number, 41u);
    EXPECT_EQ(session.log->read(0, kAll).value(), later);
    EXPECT_EQ(session.log->read(60, 1).value().front().number, 61u);
    // All later ones undone, the compacted ground is there again.
    for (std::uint64_t n = session.history.last(); n > 40; --n)
      if (!session.history.isUndone(n) && !std::holds_alternative<edits::Undo>(session.history.operation(n).what)) {
        const auto undone = session.append(1, [&] { return edits::Operation{edits::Undo{n}, 0}; });
        ASSERT_TRUE(undone) << undone.error().message;
      }
    EXPECT_EQ(session.history.layer()->hash(), hash);
    ASSERT_TRUE(session.log->compact());
  }
  EXPECT_EQ(Session::open(folder / "a.edits").value().history.layer()->hash(), hash);
}

// The past is read late: what was appended meanwhile is not a part of it.
TEST(Log, UndoesAfterEditsThatFollowedAnOpening) {
  const ScratchFolder folder;
  {
    ASSERT_TRUE(Session::open(folder / "a.edits").value().append(1, [] { return craterAt(0); }));
  }
  Session session = Session::open(folder / "a.edits").value();
  ASSERT_TRUE(session.append(1, [] { return craterAt(500); }));
  for (const std::uint64_t edit : {1, 2}) {
    const auto undone = session.append(1, [&] { return edits::Operation{edits::Undo{edit}, 0}; });
    ASSERT_TRUE(undone) << undone.error().message;
  }
  EXPECT_TRUE(session.history.layer()->empty());
}

}  // namespace
}  // namespace ridgecast::edit_log
