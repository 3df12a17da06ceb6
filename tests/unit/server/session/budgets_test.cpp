// What one client may spend, however many connections it has.
#include "server/session/budgets.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <memory>

namespace ridgecast::session {
namespace {

using namespace std::chrono_literals;

TEST(Budgets, BytesOfEditsHaveABudget) {
  Budgets budgets;
  const edits::Operation small{edits::Raise{{0, 0}, edits::kMinRadius, 0, 256}, 0};
  const conversation::Budget::Clock::time_point begin{1h}, end = begin + 10s;
  constexpr std::size_t kBytes = 128u << 10;
  std::uint64_t made = 0;
  for (auto now = begin; now < end; now += 1ms) made += budgets.spendEdit(small, kBytes, now) ? 1 : 0;
  constexpr std::uint64_t kASecond = kEditedBytesPerSecond / kBytes;
  EXPECT_GE(made, 10 * kASecond);
  EXPECT_LE(made, 10 * kASecond + kASecond + kASecond / 4 + 1) << "a quarter of a second that was saved up, and one that is owed";
  EXPECT_FALSE(budgets.spendEdit(small, 1, end));
  EXPECT_FALSE(budgets.areFull(end + 1s));
}

// Connections come and go, as with HTTP: each asks for its client's budgets, spends, and lets them go.
TEST(Budgets, OfAClientAreForgottenWhenTheyAreFullAndNotBefore) {
  BudgetsByClient all;
  const edits::Operation small{edits::Raise{{0, 0}, edits::kMinRadius, 0, 256}, 0};
  const conversation::Budget::Clock::time_point begin{1h}, end = begin + 10s;
  std::uint64_t made = 0;
  for (auto now = begin; now < end; now += 1ms) made += all.of("a", now)->spendEdit(small, 100, now) ? 1 : 0;
  constexpr std::uint64_t kASecond = kEditedPostsPerSecond / kMinEditedPosts;
  EXPECT_GE(made, 10 * kASecond);
  EXPECT_LE(made, 10 * kASecond + kASecond / 2 + 1) << "a quarter of a second that was saved up, and one that is owed";

  std::weak_ptr<Budgets> own = all.of("a", end);
  const auto paid = own.lock()->edits.free();
  all.of("b", paid);
  EXPECT_FALSE(own.expired()) << "its credit is not saved up";
  all.of("b", paid + 250ms);
  EXPECT_TRUE(own.expired());

  own = all.of("a", end);
  own.lock()->queries.spend(end, kHeightsPerSecond);
  all.of("b", end + 999ms);
  EXPECT_FALSE(own.expired());
  all.of("b", end + 1s);
  EXPECT_TRUE(own.expired());
}

// Two servers, each of which tells the other every second: a client that asks both as often as it may gets little more than of one.
TEST(Budgets, OfHeightsMayBeUnlimited) {
  BudgetsByClient all(0);
  const Budgets::Time now{1h};
  for (const char* client : {"ann", ""}) {
    const auto own = all.of(client, now);
    for (int k = 0; k < 1000; ++k) own->queries.spend(now, 1'000'000'000);
    EXPECT_LE(own->queries.free(), now) << client;
    EXPECT_TRUE(own->areFull(now)) << client;
  }
}

TEST(Budgets, OfSeveralServersAreSpentTogether) {
  std::array<BudgetsByClient, 3> servers;
  const conversation::Budget::Clock::time_point begin{1h}, end = begin + 60s;
  constexpr std::uint64_t kCost = kHeightsPerSecond / 50;
  std::uint64_t spent = 0;
  for (auto now = begin; now < end; now += 1ms) {
    for (BudgetsByClient& server : servers) {
      const auto own = server.of("a", now);
      if (own->queries.free() > now) continue;
      own->queries.spend(now, kCost);
      spent += kCost;
    }
    if ((now - begin) % 1s != 0ms) continue;
    for (BudgetsByClient& from : servers)
      for (const Spent& told : from.takeSpent()) {
        EXPECT_EQ(told.client, "a");
        for (BudgetsByClient& to : servers)
          if (&to != &from) to.charge(told, now);
      }
  }
  EXPECT_GE(spent, 55 * kHeightsPerSecond);
  EXPECT_LE(spent, 64 * kHeightsPerSecond);
}

TEST(Budgets, ThatWereSpentAreKeptUntilTheOthersWereToldAndNoLonger) {
  BudgetsByClient all;
  const conversation::Budget::Clock::time_point now{1h};
  EXPECT_TRUE(all.takeSpent().empty());
  std::weak_ptr<Budgets> own = all.of("a", now);
  own.lock()->queries.spend(now, kHeightsPerSecond / 90);
  own.lock()->repairs.spend(now, 1);  // does not matter
  all.of("b", now + 10s);
  ASSERT_FALSE(own.expired());
  const auto told = all.takeSpent();
  ASSERT_EQ(told.size(), 1u);
  EXPECT_EQ(told[0].client, "a");
  EXPECT_EQ(told[0].amounts, (std::array<std::uint64_t, 5>{kHeightsPerSecond / 90, 0, 0, 0, 0}));
  EXPECT_TRUE(all.takeSpent().empty()) << "once";
  all.of("b", now + 10s);
  EXPECT_TRUE(own.expired());
}

}  // namespace
}  // namespace ridgecast::session
