#pragma once
// A budget for request bodies, from when their bytes arrive until the answer is sent: kMax bytes in all, half of that for one client.
// Any thread. Private to the room.

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "common/outcome/contract.h"

namespace ridgecast::net {

class RequestBodyBudget {
 public:
  static constexpr std::size_t kMax = std::size_t{64} << 20;
  enum class Full { kAll, kShare };

  // One body's share, released with it.
  class Room {
   public:
    Room(std::shared_ptr<RequestBodyBudget> bodies, std::string client) : bodies_(std::move(bodies)), client_(std::move(client)) {}
    ~Room() { bodies_->give(client_, bytes_); }
    Room(const Room&) = delete;
    Room& operator=(const Room&) = delete;
    // To no less than now. If the budget is full, it keeps what it has.
    std::optional<Full> growTo(std::size_t bytes) {
      expects(bytes >= bytes_, "a body grows");
      const auto full = bodies_->take(client_, bytes - bytes_);
      if (!full) bytes_ = bytes;
      return full;
    }

   private:
    const std::shared_ptr<RequestBodyBudget> bodies_;
    const std::string client_;
    std::size_t bytes_ = 0;
  };

 private:
  std::optional<Full> take(const std::string& client, std::size_t bytes) {
    if (bytes == 0) return {};
    const std::lock_guard lock(mutex_);
    const auto own = byClient_.find(client);
    if (bytes + (own == byClient_.end() ? 0 : own->second) > kMax / 2) return Full::kShare;
    if (bytes + all_ > kMax) return Full::kAll;
    all_ += bytes;
    byClient_[client] += bytes;
    return {};
  }
  void give(const std::string& client, std::size_t bytes) {
    if (bytes == 0) return;
    const std::lock_guard lock(mutex_);
    const auto own = byClient_.find(client);
    expects(own != byClient_.end() && own->second >= bytes && all_ >= bytes, "what is given back was taken");
    all_ -= bytes;
    own->second -= bytes;
    if (own->second == 0) byClient_.erase(own);
  }

  std::mutex mutex_;
  std::size_t all_ = 0;
  std::map<std::string, std::size_t> byClient_;
};

}  // namespace ridgecast::net
