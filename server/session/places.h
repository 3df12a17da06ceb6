#pragma once
// Places for a server's cameras, the triangles set aside for each, and what all cameras of one client share.
//
// A camera has at least settings::kMinBudget. Beyond that it is granted what is left after reserving as much for every camera that may
// still come (at most half of all). What a camera was granted stays set aside until it ends: its mesh keeps its memory.

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

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

// What one client spends on all its connections together. Any thread.
struct Budgets {
  conversation::SharedBudget queries{kHeightsPerSecond}, repairs{conversation::kRepairBytesPerSecond};
  conversation::SharedBudget edits{kEditedPostsPerSecond}, editBytes{kEditedBytesPerSecond}, messages{kMessageBytesPerSecond};
  // Spends an edit's bytes and posts, and returns the number of posts, unless earlier edits are not paid for yet. Error: one sentence.
  Outcome<std::uint64_t> spendEdit(const edits::Operation& operation, std::size_t bytes, conversation::Budget::Clock::time_point now);
  // Charges the posts that a made edit looked at beyond those spent: an undo makes other edits again.
  void spendRest(std::uint64_t spent, std::uint64_t looked, conversation::Budget::Clock::time_point now) {
    if (looked > spent) edits.spend(now, looked - spent);
  }
  // New ones could spend no more.
  bool areFull(conversation::Budget::Clock::time_point now) const {
    return queries.isFull(now) && repairs.isFull(now) && edits.isFull(now) && editBytes.isFull(now) && messages.isFull(now);
  }
};

// Any thread.
class Places : public std::enable_shared_from_this<Places> {
 public:
  Places(std::uint32_t cameras, std::uint64_t triangles) : maxCameras_(cameras), maxTriangles_(triangles) {}  // triangles 0: unlimited

  // One camera's place; given back when destroyed.
  class Place {
   public:
    explicit Place(std::shared_ptr<Places> places) : places_(std::move(places)) {}
    ~Place();
    Place(const Place&) = delete;
    Place& operator=(const Place&) = delete;
    // The budget for a camera that requests this one: the same or less.
    std::uint32_t grant(std::uint32_t requested);

   private:
    friend class Places;
    const std::shared_ptr<Places> places_;
    std::uint64_t triangles_ = 0;  // set aside; under the lock
  };
  // Error: there are as many cameras as there may be, or no triangles are left for another.
  Outcome<std::shared_ptr<Place>> enter();
  // `client`: as http::Request::client; empty: unknown, shared with nobody. Budgets outlive the client's connections until they are full
  // again; `now` is a time of the session's timer.
  std::shared_ptr<Budgets> budgetsOf(const std::string& client, conversation::Budget::Clock::time_point now);
  std::uint32_t cameras() const;
  std::uint64_t triangles() const;  // set aside for all

 private:
  const std::uint32_t maxCameras_;
  const std::uint64_t maxTriangles_;
  mutable std::mutex mutex_;
  std::uint32_t cameras_ = 0;
  std::uint64_t triangles_ = 0;  // set aside
  std::map<std::string, std::shared_ptr<Budgets>> budgets_;
};

}  // namespace ridgecast::session
