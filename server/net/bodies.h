#pragma once
// Room for the bodies of requests, from before they are read until the answer is sent: kMost bytes in all, half of them of one client.
// Any thread. Private to the room.

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <variant>

namespace ridgecast::net {

class Bodies : public std::enable_shared_from_this<Bodies> {
 public:
  static constexpr std::size_t kMost = std::size_t{64} << 20;

  enum class Full { kAll, kShare };
  using Room = std::shared_ptr<const void>;  // given back with its last copy
  std::variant<Room, Full> take(const std::string& client, std::size_t bytes) {
    if (bytes == 0) return Room();
    const std::lock_guard lock(mutex_);
    const auto own = byClient_.find(client);
    if (bytes + (own == byClient_.end() ? 0 : own->second) > kMost / 2) return Full::kShare;
    if (bytes + all_ > kMost) return Full::kAll;
    all_ += bytes;
    byClient_[client] += bytes;
    return Room(nullptr, [self = shared_from_this(), client, bytes](const void*) { self->giveBack(client, bytes); });
  }

 private:
  void giveBack(const std::string& client, std::size_t bytes) {
    const std::lock_guard lock(mutex_);
    all_ -= bytes;
    const auto own = byClient_.find(client);
    own->second -= bytes;
    if (own->second == 0) byClient_.erase(own);
  }

  std::mutex mutex_;
  std::size_t all_ = 0;
  std::map<std::string, std::size_t> byClient_;
};

}  // namespace ridgecast::net
