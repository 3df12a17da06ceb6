#pragma once
// Internal to the room.

#include <cstdint>
#include <deque>
#include <future>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "common/outcome/outcome.h"

namespace ridgecast::connection {

// Requests with an id, waiting to leave or for their answers: at most `atATime` have left, at most `waiting` wait. Not thread-safe.
template <class Request, class Reply>
class PendingRequests {
 public:
  PendingRequests(std::size_t atATime, std::size_t waiting) : atATime_(atATime), most_(waiting) {}

  std::future<Outcome<Reply>> add(Request request, std::optional<Error> refusal) {
    std::promise<Outcome<Reply>> promise;
    auto future = promise.get_future();
    if (!refusal && waiting_.size() >= most_) refusal = Error{"more than " + std::to_string(most_) + " questions wait for the server"};
    if (refusal) {
      promise.set_value(*refusal);
      return future;
    }
    request.id = ++last_;
    waiting_.emplace_back(std::move(request), std::move(promise));
    return future;
  }
  // The next that may leave.
  std::optional<Request> next() {
    if (waiting_.empty() || open_.size() >= atATime_) return std::nullopt;
    auto [request, promise] = std::move(waiting_.front());
    waiting_.pop_front();
    open_.emplace(request.id, std::move(promise));
    return std::move(request);
  }
  bool take(std::uint64_t id, Reply reply) {
    const auto it = open_.find(id);
    if (it == open_.end()) return false;
    it->second.set_value(std::move(reply));
    open_.erase(it);
    return true;
  }
  void fail(const Error& error) {
    for (auto& [id, promise] : open_) promise.set_value(error);
    for (auto& [request, promise] : waiting_) promise.set_value(error);
    open_.clear();
    waiting_.clear();
  }

 private:
  const std::size_t atATime_, most_;
  std::uint64_t last_ = 0;
  std::deque<std::pair<Request, std::promise<Outcome<Reply>>>> waiting_;
  std::map<std::uint64_t, std::promise<Outcome<Reply>>> open_;
};

}  // namespace ridgecast::connection
