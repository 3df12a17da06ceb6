// Programs that the server runs: what they inherit, their limits and their ends.
#include "common/process/child.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "tests/support/process.h"

namespace ridgecast::process {
namespace {

TEST(Child, InheritsNothingThatIsOpenHere) {
  constexpr int kFar = 77;
  ASSERT_EQ(dup2(0, kFar), kFar);
  const auto end = runChild("/bin/sh", {"-c", "ls -1 /proc/$$/fd; echo done"});
  close(kFar);
  ASSERT_TRUE(end) << end.error().message;
  EXPECT_THAT(end->output,
              testing::AllOf(testing::HasSubstr("1\n2\n"), testing::HasSubstr("done"), testing::Not(testing::HasSubstr("77"))));
}

TEST(Child, ThatASignalEndsSaysWhichOne) {
  const auto end = runChild("/bin/sh", {"-c", "kill -SEGV $$"});
  ASSERT_TRUE(end) << end.error().message;
  EXPECT_EQ(end->status, -1);
  EXPECT_EQ(end->signal, SIGSEGV);
}

TEST(Child, HasTheLimitsThatWereSet) {
  const auto end = runChild("/bin/sh", {"-c", "ulimit -v; ulimit -c; ulimit -t; ulimit -f"},
                            {.time = std::chrono::seconds(40), .memory = std::uint64_t{1} << 30, .fileSize = 512 * 7});
  ASSERT_TRUE(end) << end.error().message;
  EXPECT_EQ(end->output, "1048576\n0\n40\n7\n");
}

// A server whose processors are busy must not refuse a good terrain: what counts is the work of each process, not the clock's time.
TEST(Child, EndsByItsWorkAndNotByTheClock) {
  const auto slow = runChild("/bin/sh", {"-c", "sleep 2; echo done"}, {.time = std::chrono::seconds(1)});
  ASSERT_TRUE(slow) << slow.error().message;
  EXPECT_FALSE(slow->timedOut);
  EXPECT_EQ(slow->output, "done\n");
  // Beside many others a second of work takes longer than a program may wait for it, and the clock ends it.
  auto hasWaited = [began = std::chrono::steady_clock::now()]() mutable {
    const auto now = std::chrono::steady_clock::now();
    return now - std::exchange(began, now) >= std::chrono::seconds(kMaxWaiting);
  };
  hasWaited();
  const auto busy = runChild("/bin/sh", {"-c", "while :; do :; done"}, {.time = std::chrono::seconds(1)});
  ASSERT_TRUE(busy) << busy.error().message;
  EXPECT_TRUE(busy->timedOut);
  if (!hasWaited()) EXPECT_EQ(busy->signal, SIGXCPU);
  const auto child = runChild("/bin/sh", {"-c", "/bin/sh -c 'while :; do :; done'; exit 1"}, {.time = std::chrono::seconds(1)});
  ASSERT_TRUE(child) << child.error().message;
  if (!hasWaited()) {
    EXPECT_EQ(child->status, 1);
    EXPECT_THAT(child->output, testing::HasSubstr("CPU time limit exceeded"));  // as library.cpp reads of a compiler
  }
  const auto asleep = runChild("/bin/sh", {"-c", "sleep 60"}, {.time = std::chrono::seconds(1)});
  ASSERT_TRUE(asleep) << asleep.error().message;
  EXPECT_TRUE(asleep->timedOut);
}

TEST(Child, ReachesWhatItMayAndNothingElse) {
  if (!ReachRules::areKept()) GTEST_SKIP() << "this kernel has no Landlock";
  testing_support::ScratchFolder mine, other;
  for (const auto& folder : {mine / "", other / ""}) std::ofstream(folder / "file") << "here\n";
  std::filesystem::create_symlink(other / "file", mine / "link");
  ChildLimits limits;
  limits.reach = Reach{{"/usr", "/bin", "/lib", "/lib64", "/etc/ld.so.cache", "/dev/null", mine / "", "/not/there"}, {}};
  const auto run = [&](const std::string& script) {
    const auto end = runChild("/bin/sh", {"-c", "cd '" + (mine / "").string() + "'; " + script}, limits);
    EXPECT_TRUE(end) << end.error().message;
    return end ? std::to_string(end->status) + " " + end->output : "";
  };
  EXPECT_EQ(run("cat file"), "0 here\n");
  EXPECT_THAT(run("cat link"), testing::HasSubstr("Permission denied"));
  EXPECT_THAT(run("cat '" + (other / "file").string() + "'"), testing::HasSubstr("Permission denied"));
  EXPECT_THAT(run("ls '" + (other / "").string() + "'"), testing::HasSubstr("Permission denied"));
  EXPECT_THAT(run("cat /etc/passwd"), testing::HasSubstr("Permission denied"));
  EXPECT_THAT(run("echo more > file"), testing::HasSubstr("Permission denied"));
  EXPECT_THAT(run("rm file"), testing::HasSubstr("Permission denied"));
  limits.reach->writes.push_back(mine / "");
  EXPECT_EQ(run("echo more > file; cat file; rm file"), "0 more\n");
  EXPECT_THAT(run("echo more > '" + (other / "file").string() + "'"), testing::HasSubstr("Permission denied"));
}

TEST(Child, WithoutAProgramIsAnError) {
  const auto end = runChild("/nowhere/program", {});
  ASSERT_FALSE(end);
  EXPECT_EQ(end.error().message, "cannot start /nowhere/program");
}

}  // namespace
}  // namespace ridgecast::process
