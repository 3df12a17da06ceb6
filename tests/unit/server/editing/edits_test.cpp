// A session's edits beside what makes them: bounds, what is said of changes, and that a camera's iterations follow.
#include "server/editing/edits.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/edits/author.h"
#include "common/edits/packed.h"
#include "server/directory/directory.h"
#include "server/edit_log/clients.h"
#include "server/edit_log/database.h"
#include "server/edit_log/log.h"
#include "server/member/camera_session.h"
#include "tests/support/crater.h"
#include "tests/support/process.h"
#include "tests/unit/server/member/scripted.h"

namespace ridgecast::editing {
namespace {

using directory::Directory;
using session::flatTerrain, session::Resources, session::Session;
using namespace std::chrono_literals;
using lattice::Step;

using testing_support::craterAt;
using testing_support::m;

struct Rig {
  explicit Rig(std::function<void()> changed = [] {})
      : edits(
            std::make_shared<Edits>(flatTerrain(), executor, executor, std::make_shared<EditSpace>(), std::move(changed), Edits::Kept())) {}
  std::future<Outcome<std::uint64_t>> ask(edits::Operation operation, const std::string& key = "") {
    auto promise = std::make_shared<std::promise<Outcome<std::uint64_t>>>();
    auto future = promise->get_future();
    edits->ask({key, "ann", std::move(operation)},
               [promise](const Outcome<std::uint64_t>& number, std::uint64_t) { promise->set_value(number); });
    return future;
  }
  scheduling::Executor executor{1};
  std::shared_ptr<Edits> edits;
};

TEST(Edits, AreMadeInTheOrderOfTheirNumbersAndSayWhatTheyChanged) {
  std::atomic<int> changes{0};
  Rig rig([&] { ++changes; });
  EXPECT_EQ(rig.ask(craterAt(0)).get().value(), 1u);
  EXPECT_EQ(rig.ask(craterAt(100)).get().value(), 2u);
  EXPECT_FALSE(rig.ask({edits::Undo{3}, 0}).get());
  EXPECT_EQ(changes, 2);
  EXPECT_EQ(rig.edits->ground().edit, 2u);
  EXPECT_LT(rig.edits->ground().terrain->height({m(100), 0}), -0.9);
  const Edits::News news = rig.edits->since(1);
  EXPECT_EQ(news.ground.edit, 2u);
  ASSERT_EQ(news.changed.size(), 1u);
  EXPECT_TRUE(news.changed[0].holds({m(100), 0}));
  EXPECT_FALSE(news.changed[0].holds({0, 0}));
  EXPECT_TRUE(rig.edits->since(2).changed.empty());
}

TEST(Edits, WhoMissedManyIsToldFewAreasThatHoldThemAll) {
  Rig rig;
  const int many = static_cast<int>(Edits::kMaxAreas) + 40;
  std::future<Outcome<std::uint64_t>> last;
  for (int k = 0; k < many; ++k) last = rig.ask(craterAt(40 * k));
  ASSERT_TRUE(last.get());
  const Edits::News news = rig.edits->since(0);
  EXPECT_EQ(news.changed.size(), Edits::kMaxAreas);
  for (int k = 0; k < many; ++k)
    EXPECT_TRUE(std::ranges::any_of(news.changed, [&](const lattice::Area& a) { return a.holds({m(40 * k), 0}); })) << k;
}

TEST(Edits, WhatWaitsIsBounded) {
  Rig rig;
  std::promise<void> go, began;
  const auto blocked = rig.executor.makePool(1);
  ASSERT_TRUE(blocked->post([&began, wait = go.get_future().share()] {
    began.set_value();
    wait.wait();
  }));
  began.get_future().wait();  // or edits would go ahead
  std::vector<std::future<Outcome<std::uint64_t>>> waiting;
  for (std::size_t k = 0; k < Edits::kMaxWaiting; ++k) waiting.push_back(rig.ask(craterAt(static_cast<double>(k))));
  const auto refused = rig.ask(craterAt(0)).get();  // at once
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("256"), std::string::npos);
  go.set_value();
  for (auto& one : waiting) EXPECT_TRUE(one.get());
  EXPECT_EQ(rig.edits->ground().edit, Edits::kMaxWaiting);
}

TEST(Edits, OfOnlySoManySessionsAreKept) {
  const testing_support::ScratchFolder folder;
  for (std::size_t k = 1; k < directory::kMaxKept; ++k) std::ofstream(folder / ("s" + std::to_string(k) + ".edits"));
  scheduling::Executor executor(1);
  auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  resources->state = folder / "";
  const auto directory = std::make_shared<Directory>(resources, flatTerrain());
  const auto edit = [&](Session& session) {
    std::promise<Outcome<std::uint64_t>> made;
    session.edits().ask({"", "ann", craterAt(0)}, [&](const Outcome<std::uint64_t>& number, std::uint64_t) { made.set_value(number); });
    return made.get_future().get();
  };
  EXPECT_EQ(edit(*directory->find("default")).value(), 1u);
  const auto other = directory->add("other", flatTerrain()).value();
  const auto refused = edit(*other);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("4096 sessions"), std::string::npos);
  EXPECT_EQ(other->ground().edit, 0u);
  EXPECT_EQ(edit(*directory->find("default")).value(), 2u);
}

// What makes other edits again costs as much as they do.
TEST(Edits, AnUndoIsPaidFor) {
  scheduling::Executor executor(1);
  auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  Directory directory(resources, flatTerrain());
  const auto session = directory.find("default");
  const auto budgets = std::make_shared<session::Budgets>();
  const auto ask = [&](edits::Operation operation) {
    auto promise = std::make_shared<std::promise<Outcome<std::uint64_t>>>();
    auto made = promise->get_future();
    session->edit({"", "ann", std::move(operation)}, budgets, [promise](const auto& number) { promise->set_value(number); });
    return made.get();
  };
  const edits::Operation wide{edits::Level{{{m(-200), m(-200)}, {m(-200), m(200)}, {m(200), m(200)}, {m(200), m(-200)}}, 0, 0, 256}, 0};
  const std::chrono::duration<double> cost(static_cast<double>(edits::areaOf(wide).count()) /
                                           static_cast<double>(session::kEditedPostsPerSecond));
  for (std::uint64_t number = 1; number <= 4; ++number)
    while (!ask(wide)) std::this_thread::sleep_for(10ms);
  const auto start = budgets->edits.free();
  while (!ask({edits::Undo{1}, 0})) std::this_thread::sleep_for(10ms);
  EXPECT_GT(budgets->edits.free() - start, 2.9 * cost) << "edits 2 to 4 were made again";
}

// A client's edits, in a session that is kept in a folder or, without one, in memory.
struct Payer {
  explicit Payer(const std::filesystem::path& state = {}) {
    resources->executor = &executor;
    resources->state = state;
    directory = std::make_unique<Directory>(resources, flatTerrain());
    session = directory->find("default");
  }
  std::future<Edits::Answer> ask(edits::Operation operation, const std::string& key = "", const edits::Author& author = kLab) {
    auto promise = std::make_shared<std::promise<Edits::Answer>>();
    auto future = promise->get_future();
    session->edit({key, edits::toText(author), std::move(operation)}, budgets,
                  [promise](const auto& number) { promise->set_value(number); });
    return future;
  }
  void owe() { budgets->edits.spend(resources->timer->now(), 600 * session::kEditedPostsPerSecond); }
  // Nothing is made until `go` is set.
  void hold() {
    const auto blocked = executor.makePool(1);
    std::promise<void> began;
    ASSERT_TRUE(blocked->post([&began, wait = go.get_future().share()] {
      began.set_value();
      wait.wait();
    }));
    began.get_future().wait();
  }
  static inline const edits::Author kLab{"token of lab", "ann"};
  std::promise<void> go;
  scheduling::Executor executor{1};
  std::shared_ptr<Resources> resources = std::make_shared<Resources>();
  std::unique_ptr<Directory> directory;
  std::shared_ptr<Session> session;
  std::shared_ptr<session::Budgets> budgets = std::make_shared<session::Budgets>();
};

TEST(Edits, OneClientBeginsHalfOfTheSessionsThatAreKept) {
  const testing_support::ScratchFolder folder;
  {
    auto clients = edit_log::Database::open(folder / edit_log::kClientsFile, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE).value();
    clients.run("BEGIN; CREATE TABLE clients(log TEXT PRIMARY KEY, client TEXT NOT NULL) WITHOUT ROWID").value();
    auto insert = clients.prepare("INSERT INTO clients VALUES(?1, 'token of lab')").value();
    for (std::size_t k = 0; k < directory::kMaxKept / 2; ++k) {
      const std::string log = "s" + std::to_string(k) + ".edits";
      std::ofstream(folder / log).flush();
      insert.run(std::string_view(log)).value();
    }
    clients.run("COMMIT").value();
  }
  Payer payer(folder / "");
  const auto refused = payer.ask(craterAt(0), "", {"token of lab", "bob"}).get();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("2048 sessions that one client began"), std::string::npos) << refused.error().message;
  EXPECT_EQ(payer.ask(craterAt(0), "", {"token of shop", "ann"}).get().value(), 1u);
  EXPECT_EQ(payer.ask(craterAt(0), "", {"token of lab", "bob"}).get().value(), 2u) << "its log is there";
}

TEST(Edits, KnownKeysAreAnsweredBeforeAnythingIsCharged) {
  Payer payer;
  ASSERT_EQ(payer.ask(craterAt(0), "k").get().value(), 1u);
  payer.owe();
  const auto paid = payer.budgets->edits.free();
  for (int k = 0; k < 50; ++k) EXPECT_EQ(payer.ask(craterAt(0), "k").get().value(), 1u);
  EXPECT_EQ(payer.budgets->edits.free(), paid);
  EXPECT_EQ(payer.session->ground().edit, 1u);
}

// As a client does whose patience is shorter than a disk's.
TEST(Edits, KeysThatWaitAreJoinedAndPaidForOnce) {
  Payer payer;
  payer.hold();
  std::vector<std::future<Edits::Answer>> same, others;
  const edits::Operation dear{edits::Raise{{0, 0}, m(256), m(1), 1}, 0};  // a quarter of a second
  for (int k = 0; k < 50; ++k) same.push_back(payer.ask(dear, "k"));
  for (std::size_t k = 1; k < Edits::kMaxWaitingOfOne; ++k) others.push_back(payer.ask(craterAt(static_cast<double>(k))));
  same.push_back(payer.ask(dear, "k"));  // also when there is no place left
  const auto another = payer.ask(craterAt(0), "k").get();
  ASSERT_FALSE(another);
  EXPECT_NE(another.error().message.find("another edit, which waits"), std::string::npos) << another.error().message;
  payer.go.set_value();
  for (auto& one : same) EXPECT_EQ(one.get().value(), 1u);
  for (auto& one : others) one.wait();
  EXPECT_LE(payer.session->ground().edit, 1 + others.size());
}

TEST(Edits, WhatIsNotPaidForIsRefusedForNowAndNotMade) {
  Payer payer;
  payer.owe();
  for (const char* const key : {"", "k"}) {
    const auto answer = payer.ask(craterAt(0), key).get();
    ASSERT_FALSE(answer);
    EXPECT_EQ(answer.why, Edits::Answer::Why::kEarly);
    EXPECT_NE(answer.error().message.find("again in"), std::string::npos) << answer.error().message;
  }
  EXPECT_EQ(payer.session->ground().edit, 0u);
  payer.budgets = std::make_shared<session::Budgets>();
  const auto wrong = payer.ask({edits::Undo{7}, 0}).get();
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.why, Edits::Answer::Why::kWrong);
  EXPECT_EQ(payer.ask(craterAt(0), "k").get().value(), 1u);
}

TEST(Edits, OfOneClientTakeHalfOfThePlaces) {
  Payer payer;
  payer.hold();
  std::vector<std::future<Edits::Answer>> own;
  for (std::size_t k = 0; k < Edits::kMaxWaitingOfOne; ++k)
    own.push_back(payer.ask(craterAt(static_cast<double>(k)), "", {"token of lab", "n" + std::to_string(k)}));
  const auto refused = payer.ask(craterAt(0)).get();
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.why, Edits::Answer::Why::kEarly);
  EXPECT_NE(refused.error().message.find("of your edits"), std::string::npos) << refused.error().message;
  auto other = payer.ask(craterAt(0), "", {"token of else", ""});
  payer.go.set_value();
  for (auto& one : own) one.wait();
  other.wait();
}

TEST(Edits, AKeyBelongsToTheClientAndTheName) {
  Payer payer;
  const edits::Author authors[] = {{"token of lab", ""},
                                   {"token of guest", ""},
                                   {"token of lab", "ann"},
                                   {"token of guest", "ann"},
                                   {"address 192.0.2.1", ""},
                                   {"address 192.0.2.2", ""},
                                   {"token of guest", "token of lab"},
                                   {"address 192.0.2.2", "address 192.0.2.1"}};
  std::uint64_t number = 0;
  for (const edits::Author& author : authors)
    EXPECT_EQ(payer.ask(craterAt(0), "k", author).get().value(), ++number) << edits::toText(author);
  number = 0;
  for (const edits::Author& author : authors)
    EXPECT_EQ(payer.ask(craterAt(0), "k", author).get().value(), ++number) << edits::toText(author);
}

// Made in this process or before it.
TEST(Edits, AKeyOfAnotherEditIsRefused) {
  const testing_support::ScratchFolder folder;
  const edits::Operation road{edits::Road{{{0, 0, 0}, {m(40), m(9), 0}}, false, m(6), 26, 171}, 0};
  for (const bool again : {false, true}) {
    Payer payer(folder / "");
    EXPECT_EQ(payer.ask(craterAt(0), "k").get().value(), 1u);
    EXPECT_EQ(payer.ask(road, "r").get().value(), 2u);
    const auto another = payer.ask(craterAt(5), "k").get();
    ASSERT_FALSE(another) << "acknowledged, and not made";
    EXPECT_EQ(another.why, Edits::Answer::Why::kWrong);
    EXPECT_NE(another.error().message.find("another edit, number 1"), std::string::npos) << another.error().message;
    EXPECT_FALSE(payer.ask(road, "k").get());
    EXPECT_EQ(payer.session->ground().edit, 2u) << again;
  }
}

// Logs from before clients were known beside their names.
TEST(Edits, KeysOfOlderLogsAreKnownAgainByTheirEdits) {
  const testing_support::ScratchFolder folder;
  {
    const auto terrain = flatTerrain();
    auto log = edit_log::Log::create(folder / "default.edits",
                                     {std::string(terrain->name()), terrain->seed(), {}, terrain::contentHash(*terrain)});
    ASSERT_TRUE(log) << log.error().message;
    edits::History history(terrain);
    const auto before = history.layer();
    const std::vector<edits::Posts> changed{history.add(craterAt(0)).value()};
    const Applied made{1, "\nann\nk", "ann", 0, edits::pack(craterAt(0)), edits::groundOf(changed[0])};
    ASSERT_TRUE((*log)->append({&made, 1}, {*before, *history.layer(), changed}));
  }
  Payer payer(folder / "");
  EXPECT_EQ(payer.ask(craterAt(0), "k").get().value(), 1u);
  EXPECT_EQ(payer.ask(craterAt(5), "k").get().value(), 2u) << "the key may have been another ann's";
  EXPECT_EQ(payer.ask(craterAt(0), "k", {"token of lab", "bob"}).get().value(), 3u);
  std::promise<std::vector<Applied>> read;
  payer.session->edits().read(0, 1 << 20, [&](auto made) { read.set_value(std::move(made).value()); });
  const auto made = read.get_future().get();
  EXPECT_EQ(edits::authorOf(made.at(0).author), (edits::Author{"ann", ""}));
  EXPECT_EQ(edits::authorOf(made.at(1).author), (edits::Author{"token of lab", "ann"}));
}

// Files kept by a ground's hash must not be another ground's.
TEST(Edits, AreAnotherGroundInTheNextSessionOfThatName) {
  scheduling::Executor executor(1);
  auto resources = std::make_shared<Resources>();
  resources->executor = &executor;
  const auto hashAfter = [&](double x) {
    Directory directory(resources, flatTerrain());
    const auto session = directory.find("default");
    const std::uint64_t before = session->hashOf(session->ground());
    std::promise<void> made;
    session->edits().ask({"", "ann", craterAt(x)}, [&](const Outcome<std::uint64_t>&, std::uint64_t) { made.set_value(); });
    made.get_future().wait();
    EXPECT_NE(session->hashOf(session->ground()), before);
    EXPECT_EQ(session->hashOf(session->ground()), session->hashOf(session->ground()));
    return std::pair(before, session->hashOf(session->ground()));
  };
  const auto first = hashAfter(0), second = hashAfter(50);
  EXPECT_EQ(first.first, second.first);
  EXPECT_NE(first.second, second.second);
}

}  // namespace
}  // namespace ridgecast::editing
