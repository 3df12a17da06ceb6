#pragma once
// How many and how often: counts by client, and rates.

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "common/outcome/contract.h"
#include "server/access/network.h"

namespace ridgecast::access {

// Connections of each client. One entry for each client that has any. Any thread.
class ConnectionsByAddress {
  struct State {
    std::mutex mutex;
    std::map<Address, std::uint32_t> counts;
  };

 public:
  explicit ConnectionsByAddress(std::uint32_t mostEach) : mostEach_(mostEach) {}  // 0: no limit

  // Released when destroyed; may outlive the ConnectionsByAddress.
  class Place {
   public:
    Place(Place&&) = default;
    Place& operator=(Place&& other) noexcept {
      std::swap(state_, other.state_);
      std::swap(who_, other.who_);
      return *this;
    }
    ~Place() {
      if (!state_) return;
      const std::lock_guard lock(state_->mutex);
      const auto found = state_->counts.find(who_);
      expects(found != state_->counts.end() && found->second > 0, "a connection that ends was counted");
      if (--found->second == 0) state_->counts.erase(found);
    }
    const Address& who() const { return who_; }

   private:
    friend class ConnectionsByAddress;
    Place(std::shared_ptr<State> state, const Address& who) : state_(std::move(state)), who_(who) {}
    std::shared_ptr<State> state_;
    Address who_;
  };
  // A place for a connection of this client (its household). Nothing: the client is at its limit.
  std::optional<Place> enter(const Address& client) {
    const Address who = household(client);
    const std::lock_guard lock(state_->mutex);
    std::uint32_t& count = state_->counts[who];
    if (mostEach_ != 0 && count >= mostEach_) return std::nullopt;
    ++count;
    return Place(state_, who);
  }

 private:
  const std::uint32_t mostEach_;
  const std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace ridgecast::access
