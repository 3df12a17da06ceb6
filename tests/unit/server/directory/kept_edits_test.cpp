// Edits that outlive their sessions: whose a name is, that a session which has ended takes nothing more, and what clients hear of files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/edits/packed.h"
#include "server/directory/directory.h"
#include "server/session/session.h"
#include "tests/support/crater.h"
#include "tests/support/process.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::session {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing_support::craterAt;

// Tasks run when work() says so.
struct Served {
  explicit Served(const std::filesystem::path& state) {
    resources->executor = &executor;
    resources->state = state;
    directory = std::make_shared<Directory>(resources, flatTerrain());
  }
  ~Served() { executor.work(); }
  std::shared_ptr<Session> add(const std::string& name) const { return directory->add(name, flatTerrain()).value(); }
  // Its answer, once the work is done.
  static std::shared_ptr<std::optional<Outcome<std::uint64_t>>> ask(Session& session, double x = 0) {
    auto answer = std::make_shared<std::optional<Outcome<std::uint64_t>>>();
    session.edit({"", "ann", craterAt(x)}, std::make_shared<Budgets>(), [answer](const auto& number) { *answer = number; });
    return answer;
  }
  Outcome<std::uint64_t> edit(Session& session, double x = 0) {
    const auto answer = ask(session, x);
    executor.work();
    return answer->value();
  }

  scheduling::Executor executor{scheduling::Executor::WithoutThreads{}};
  std::shared_ptr<Resources> resources = std::make_shared<Resources>();
  std::shared_ptr<Directory> directory;
};

class KeptEdits : public testing::Test {
 protected:
  testing_support::ScratchFolder folder;
  const std::filesystem::path state = folder / "state", site = state / "site.edits";
};

TEST_F(KeptEdits, OneOfThoseWhoComeAtOnceOpensThem) {
  {
    Served server(state);
    ASSERT_EQ(server.edit(*server.add("site")).value(), 1u);
  }
  Served server(state);
  for (int round = 0; round < 20; ++round) {
    std::vector<std::unique_ptr<directory::Reservation>> reserved(8);
    {
      std::vector<std::jthread> all;
      for (auto& one : reserved)
        all.emplace_back([&] {
          auto reservation = server.directory->reserve("site");
          EXPECT_TRUE(reservation) << reservation.error().message;
          if (reservation) one = std::move(*reservation);
        });
    }
    EXPECT_EQ(std::count(reserved.begin(), reserved.end(), nullptr), 7);
    for (const auto& one : reserved)
      if (one) {
        ASSERT_TRUE(one->kept());
        EXPECT_EQ(one->kept()->terrain, flatTerrain()->name());
      }
    EXPECT_THAT(edit_log::Log::open(site).error().message, HasSubstr("in use by another program"));
  }
  const auto session = server.add("site");
  EXPECT_FALSE(server.directory->reserve("site").value());
  EXPECT_EQ(server.edit(*session).value(), 2u);
}

TEST_F(KeptEdits, ASessionThatHasEndedTakesNoneAndTheNextDoes) {
  for (const bool isKept : {false, true}) {
    Served server(isKept ? state : std::filesystem::path());
    const auto removed = server.add("site");
    const auto waiting = Served::ask(*removed);
    ASSERT_TRUE(server.directory->remove("site"));
    const auto late = Served::ask(*removed);
    EXPECT_EQ(static_cast<bool>(server.directory->reserve("site").value()), !isKept) << "its log is not closed yet";
    server.executor.work();
    for (const auto& answer : {waiting, late}) EXPECT_THAT(answer->value().error().message, HasSubstr("has ended"));
    EXPECT_TRUE(removed->edits().isOver());
    EXPECT_EQ(removed->ground().edit, 0u);
    const auto next = server.add("site");
    EXPECT_EQ(server.edit(*next).value(), 1u);
    EXPECT_EQ(server.edit(*next, 50).value(), 2u);
    EXPECT_FALSE(server.edit(*removed));
    if (!isKept) continue;
    ASSERT_TRUE(server.directory->remove("site"));
    server.executor.work();
    const auto third = server.add("site");
    EXPECT_EQ(third->ground().edit, 2u);
    EXPECT_EQ(server.edit(*third).value(), 3u);
  }
}

TEST_F(KeptEdits, AListOfASessionThatHasEndedIsRefusedNotEmpty) {
  {
    Served server(state);
    ASSERT_EQ(server.edit(*server.add("site")).value(), 1u);
  }
  Served server(state);
  const auto session = server.add("site");
  ASSERT_TRUE(server.directory->remove("site"));
  std::optional<Outcome<std::vector<editing::Applied>>> list;
  session->edits().read(0, 1000, [&](auto made) { list = std::move(made); });
  server.executor.work();
  EXPECT_THAT(list->error().message, HasSubstr("has ended"));
}

// Somebody puts a log beside a session that began without one.
TEST_F(KeptEdits, ANewLogIsNew) {
  Served server(state);
  const auto session = server.add("site");
  const auto stranger = folder / "site.edits";
  const editing::Applied made{1, "", "", 0, edits::pack(craterAt(0)), {}};
  ASSERT_TRUE(edit_log::Log::create(stranger, {}).value()->append({&made, 1}, {{}, {}, {}}));
  std::filesystem::copy(stranger, site);
  EXPECT_THAT(server.edit(*session).error().message, HasSubstr("has edits already"));
  EXPECT_EQ(session->ground().edit, 0u);
  std::filesystem::remove(site);
  EXPECT_EQ(server.edit(*session).value(), 1u);
}

TEST_F(KeptEdits, WhatClientsHearOfFilesNamesNoFolder) {
  Served server(state);
  const auto session = server.add("site");
  std::filesystem::create_directory(site);
  const auto refusal = server.edit(*session).error().message;
  EXPECT_THAT(refusal, HasSubstr("'site.edits'"));
  EXPECT_THAT(refusal, Not(HasSubstr(folder / "")));
  std::ofstream(state / "torn.edits") << "no log";
  const auto unread = server.directory->reserve("torn").error().message;
  EXPECT_THAT(unread, HasSubstr("'torn.edits' is not a log of edits"));
  EXPECT_THAT(unread, Not(HasSubstr(folder / "")));
}

}  // namespace
}  // namespace ridgecast::session
