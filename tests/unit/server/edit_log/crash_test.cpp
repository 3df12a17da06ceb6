// Logs whose program is killed, and whose power is cut, at any instant. Laws: what append() returned for is there, once and in order; what
// it was cut off in is there whole or not at all; the cached layer is that of the edits. ROUNDS says how often, 1000 before a release.
#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "tests/support/forgetful_disk.h"
#include "tests/support/process.h"
#include "tests/support/sanitized.h"
#include "tests/unit/server/edit_log/session.h"

namespace ridgecast::edit_log {
namespace {

using testing_support::ForgetfulDisk;
using testing_support::ScratchFolder;

int rounds() {
  const char* const wanted = std::getenv("ROUNDS");
  return wanted ? std::atoi(wanted) : 15;
}

// What a child tells of an edit that is on disk.
struct Acknowledgement {
  std::uint64_t number = 0, hash = 0;
};
std::uint64_t hashOf(const Applied& edit) { return std::hash<std::string>()(edit.operation + edit.key + edit.author); }

[[noreturn]] void appendForever(const std::filesystem::path& file, int out, std::uint64_t seed) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::mt19937_64 random(seed);
  Session session = Session::open(file).value();
  for (;;)
    for (const Applied& e : session.append(1 + random() % 8, random).value()) {
      const Acknowledgement a{e.number, hashOf(e)};
      if (write(out, &a, sizeof a) != sizeof a) _exit(1);
    }
}

TEST(Crashes, KilledAtAnyInstantTheLogHasWhatItAcknowledged) {
  const ScratchFolder folder;
  std::filesystem::path file;
  std::mt19937_64 random(21);
  std::vector<Acknowledgement> acknowledged;
  edits::History expected(alpine());
  std::size_t all = 0, unacknowledged = 0;
  for (int round = 0; round < rounds(); ++round) {
    if (round % 4 == 0) {
      file = folder / std::to_string(round);
      acknowledged.clear();
      expected = edits::History(alpine());
    }
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) appendForever(file, ends[1], random());
    close(ends[1]);
    // Soon, while it opens the file, or after it has told of some edits.
    Acknowledgement a;
    for (std::uint64_t wait = random() % 4 == 0 ? 0 : random() % 60; wait > 0 && read(ends[0], &a, sizeof a) == sizeof a; --wait, ++all)
      acknowledged.push_back(a);
    std::this_thread::sleep_for(std::chrono::microseconds(random() % (1 << (4 + random() % 12))));
    kill(child, SIGKILL);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "the child failed";
    for (; read(ends[0], &a, sizeof a) == sizeof a; ++all) acknowledged.push_back(a);
    close(ends[0]);

    const auto log = openOrCreate(file);
    ASSERT_TRUE(log) << log.error().message;
    const auto edits = (*log)->read(0, kAll);
    ASSERT_TRUE(edits) << edits.error().message;
    ASSERT_GE(edits->size(), acknowledged.size());
    for (std::size_t k = 0; k < edits->size(); ++k) {
      const Applied& e = (*edits)[k];
      ASSERT_EQ(e.number, k + 1);
      ASSERT_EQ((*log)->numberOf(e.key).value(), e.number);
      if (k < acknowledged.size()) {
        ASSERT_EQ(acknowledged[k].number, e.number);
        ASSERT_EQ(acknowledged[k].hash, hashOf(e));
      } else {  // the last group, of which the child was about to tell
        ++unacknowledged;
        acknowledged.push_back({e.number, hashOf(e)});
      }
    }
    const auto layer = (*log)->layer();
    ASSERT_TRUE(layer) << layer.error().message;
    while (expected.last() < edits->size()) ASSERT_TRUE(expected.add(operationOf((*edits)[expected.last()])));
    ASSERT_EQ((*layer)->hash(), expected.layer()->hash()) << round;
  }
  std::printf("%d kills, %zu edits acknowledged, %zu that were not\n", rounds(), all, unacknowledged);
}

// A journal from the making that came back, because its folder was not synced, once undid what followed.
TEST(Crashes, ALogWhoseMakingWasCutOffKeepsWhatFollows) {
  std::mt19937_64 random(5);
  for (int round = 0; round < testing_support::rounds(400); ++round) {
    const ScratchFolder folder;
    const std::filesystem::path file = folder / "a";
    ForgetfulDisk disk(random);
    disk.cutPowerAfter(1 + static_cast<std::uint64_t>(round) % 40);
    static_cast<void>(openOrCreate(file));  // perhaps
    disk.cutPower();
    disk.restorePower();
    {
      auto session = Session::open(file);
      ASSERT_TRUE(session) << session.error().message;
      ASSERT_TRUE(session->append(1, random));
      disk.cutPower();
    }
    disk.restorePower();
    const auto log = openOrCreate(file);
    ASSERT_TRUE(log) << log.error().message;
    ASSERT_EQ((*log)->last(), 1u) << "round " << round;
  }
}

// What a log must have.
struct Truth {
  std::uint64_t compacted = 0;
  std::vector<Applied> edits;  // after those
  std::shared_ptr<const edits::Layer> layer = std::make_shared<const edits::Layer>();
  std::vector<Applied> perhaps;  // what append() was cut off in: all or none
  bool perhapsCompacted = false;
};

void check(const std::filesystem::path& file, Truth& truth) {
  const auto log = openOrCreate(file);
  ASSERT_TRUE(log) << log.error().message;
  ASSERT_TRUE((*log)->check());
  if (truth.perhapsCompacted && (*log)->compacted() > truth.compacted) {
    truth.compacted += truth.edits.size();
    truth.edits.clear();
  }
  ASSERT_EQ((*log)->compacted(), truth.compacted);
  const bool isMore = (*log)->last() > truth.compacted + truth.edits.size();
  if (isMore) truth.edits.insert(truth.edits.end(), truth.perhaps.begin(), truth.perhaps.end());
  const auto edits = (*log)->read(0, kAll);
  ASSERT_TRUE(edits) << edits.error().message;
  ASSERT_EQ(*edits, truth.edits);
  const auto layer = (*log)->layer();
  ASSERT_TRUE(layer) << layer.error().message;
  auto history = historyOf(**log, alpine());
  ASSERT_TRUE(history);
  ASSERT_TRUE(history->replay());
  ASSERT_EQ((*layer)->hash(), history->layer()->hash());
  if (!isMore) {
    ASSERT_EQ((*layer)->hash(), truth.layer->hash());
  }
  truth.layer = *layer;
  truth.perhaps.clear();
  truth.perhapsCompacted = false;
}

// Until the power is off or the disk full. Then, with room again, it must go on.
void appendUntilItFails(const std::filesystem::path& file, ForgetfulDisk& disk, std::mt19937_64& random, Truth& truth) {
  auto session = Session::open(file);
  while (session) {
    if (random() % 64 == 0) {
      truth.perhapsCompacted = true;
      (void)session->log->compact();
      return;
    }
    const auto made = session->append(1 + random() % 6, random);
    if (made) {
      truth.edits.insert(truth.edits.end(), made->begin(), made->end());
      truth.layer = session->history.layer();
    } else if (disk.isOff()) {
      truth.perhaps = session->attempted;
      return;
    } else {
      EXPECT_NE(made.error().message.find("no room on the disk"), std::string::npos) << made.error().message;
      disk.restorePower();
      const auto again = session->append(1, random);
      ASSERT_TRUE(again) << again.error().message;
      truth.edits.push_back(again->front());
      truth.layer = session->history.layer();
      return;
    }
  }
}

TEST(Crashes, WithoutPowerTheLogKeepsWhatItAcknowledged) {
  const ScratchFolder folder;
  std::mt19937_64 random(22);
  ForgetfulDisk disk(random);
  Truth truth;
  std::filesystem::path file;
  std::size_t cuts = 0, edits = 0, cutOff = 0;
  for (int round = 0; round < rounds(); ++round) {
    if (round == 0 || random() % 8 == 0) {
      file = folder / std::to_string(round);
      truth = {};
    }
    const std::uint64_t operations = 1 + random() % (std::uint64_t{1} << (2 + random() % 10));
    if (random() % 4 == 0)
      disk.fillAfter(operations);
    else
      disk.cutPowerAfter(operations);
    const std::size_t before = truth.edits.size();
    appendUntilItFails(file, disk, random, truth);
    edits += truth.edits.size() - before;
    cutOff += !truth.perhaps.empty();
    cuts += disk.isOff();
    disk.restorePower();
    check(file, truth);
    if (HasFatalFailure()) FAIL() << "in round " << round;
  }
  std::printf("%zu power cuts, %llu writes lost, %zu edits acknowledged, %zu transactions cut off\n", cuts,
              static_cast<unsigned long long>(disk.lost()), edits, cutOff);
  EXPECT_GT(disk.lost(), 0u);
}

}  // namespace
}  // namespace ridgecast::edit_log
