#pragma once
// What one client may spend on all its connections together: heights of answers, repairs, edits, and bytes of messages. With several
// servers, what it spends on one is charged on the others within a second or two. Any thread.

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/edits/operation.h"
#include "common/outcome/outcome.h"
#include "server/conversation/conversation.h"

namespace ridgecast::session {

// Terrain heights for one client's answers: a fifth of a thread, or a thousand of the farthest rays.
inline constexpr std::uint64_t kHeightsPerSecond = 8'000'000;

// Posts that one client's edits look at; each counts as kMinEditedPosts at least. An edit is accepted while earlier ones owe at most
// kEditDebt: 100 small ones at once.
inline constexpr std::uint64_t kEditedPostsPerSecond = 4'000'000, kMinEditedPosts = 10'000;
inline constexpr std::chrono::milliseconds kEditDebt{250};
// Bytes of one client's edits, as edit_store::Applied::bytes, and how long earlier ones may owe when another is accepted: two large stamps.
inline constexpr std::uint64_t kEditedBytesPerSecond = 256u << 10;
inline constexpr std::chrono::milliseconds kEditBytesDebt{1000};

// Bytes of messages on one client's streams. The socket's threads decode them, 128 KiB in two milliseconds at worst.
inline constexpr std::uint64_t kMessageBytesPerSecond = 12u << 20;

struct Budgets {
  explicit Budgets(std::uint64_t heightsPerSecond = kHeightsPerSecond) : queries(heightsPerSecond) {}
  using Time = conversation::Budget::Clock::time_point;  // of the session's timer

  conversation::SharedBudget queries, repairs{conversation::kRepairBytesPerSecond};
  conversation::SharedBudget edits{kEditedPostsPerSecond}, editBytes{kEditedBytesPerSecond}, messages{kMessageBytesPerSecond};
  // Spends an edit's bytes and posts, and returns the number of posts, unless earlier edits are not paid for yet. Error: one sentence.
  Outcome<std::uint64_t> spendEdit(const edits::Operation& operation, std::size_t bytes, Time now);
  // Charges the posts that a made edit looked at beyond those spent: an undo makes other edits again.
  void spendRest(std::uint64_t spent, std::uint64_t looked, Time now) {
    if (looked > spent) edits.spend(now, looked - spent);
  }
  // The same of all servers, in the same order.
  std::array<conversation::SharedBudget*, 5> all() { return {&queries, &repairs, &edits, &editBytes, &messages}; }
  // New ones could spend no more.
  bool areFull(Time now) const {
    return queries.isFull(now) && repairs.isFull(now) && edits.isFull(now) && editBytes.isFull(now) && messages.isFull(now);
  }
};

// What a client has spent of each of Budgets::all().
struct Spent {
  std::string client;
  std::array<std::uint64_t, 5> amounts{};
};

// The budgets of all clients. They outlive the client's connections until they are full again.
class BudgetsByClient {
 public:
  explicit BudgetsByClient(std::uint64_t heightsPerSecond = kHeightsPerSecond) : heightsPerSecond_(heightsPerSecond) {}  // 0: unlimited
  // `client`: as http::Request::client; empty: unknown, shared with nobody.
  std::shared_ptr<Budgets> of(const std::string& client, Budgets::Time now);

  // What clients have spent on this server since the last call, where it matters (SharedBudget::hasSpent). After the first call budgets
  // outlive their connections until it was taken, too.
  std::vector<Spent> takeSpent();
  // Charges what a client has spent on another server.
  void charge(const Spent& spent, Budgets::Time now);

 private:
  const std::uint64_t heightsPerSecond_;
  std::mutex mutex_;
  bool isShared_ = false;
  std::map<std::string, std::shared_ptr<Budgets>> budgets_;
};

}  // namespace ridgecast::session
