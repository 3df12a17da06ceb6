#include "server/edit_log/clients.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/process.h"
#include "tests/unit/server/edit_log/session.h"

namespace ridgecast::edit_log {
namespace {

using testing::HasSubstr;

class Clients : public testing::Test {
 protected:
  void SetUp() override { Lock::prepare(folder).value(); }
  // What refuses it, or nothing.
  std::string begin(const std::string& name, std::string_view client, std::size_t most = 8) const {
    const auto log = createFor(client, Lock::take(folder / (name + ".edits")).value(), worldOf(*alpine()), most);
    return log ? "" : log.error().message;
  }
  testing_support::ScratchFolder scratch;
  const std::filesystem::path folder = scratch / "state";
};

// One could once take all 4,096 in a day, for ever.
TEST_F(Clients, OneBeginsHalfOfTheLogs) {
  for (int k = 0; k < 4; ++k) EXPECT_EQ(begin("a" + std::to_string(k), "token of lab"), "");
  EXPECT_THAT(begin("a4", "token of lab"), HasSubstr("at most 4 sessions that one client began; its operator can forget some"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a4.edits"));
  EXPECT_EQ(begin("b", "address 192.0.2.1"), "");
  std::filesystem::remove(folder / "a2.edits");
  EXPECT_EQ(begin("a5", "token of lab"), "");
  EXPECT_THAT(begin("a6", "token of lab"), HasSubstr("one client began"));
  EXPECT_EQ(begin("a6", "token of lab", 16), "");
}

TEST_F(Clients, LogsOlderThanTheFileBelongToNobody) {
  for (int k = 0; k < 6; ++k) std::ofstream(folder / ("old" + std::to_string(k) + ".edits"));
  EXPECT_EQ(begin("a", "ann"), "");
  EXPECT_EQ(begin("b", "ann"), "");
  EXPECT_THAT(begin("c", "bob"), HasSubstr("the edits of at most 8 sessions;"));
}

TEST_F(Clients, AreCountedOverAllThreadsAndPrograms) {
  const pid_t other = fork();
  if (other == 0) {
    int begun = 0;
    for (int k = 0; k < 20; ++k) begun += begin("p" + std::to_string(k), "lab", 40).empty();
    _exit(begun);
  }
  std::atomic<int> begun{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 2; ++t)
    threads.emplace_back([&, t] {
      for (int k = 0; k < 20; ++k) begun += begin("t" + std::to_string(t) + "." + std::to_string(k), "lab", 40).empty();
    });
  for (std::thread& thread : threads) thread.join();
  int status = 0;
  ASSERT_EQ(waitpid(other, &status, 0), other);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(begun + WEXITSTATUS(status), 20);
}

TEST_F(Clients, AFileThatCannotBeReadSaysWhatToDo) {
  std::ofstream(folder / kClientsFile) << std::string(4096, 'x');
  EXPECT_THAT(begin("a", "ann"), HasSubstr("remove it while no server runs"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.edits"));
  std::filesystem::remove(folder / kClientsFile);
  EXPECT_EQ(begin("a", "ann"), "");
  EXPECT_EQ(std::filesystem::status(folder / kClientsFile).permissions(),
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
}

}  // namespace
}  // namespace ridgecast::edit_log
