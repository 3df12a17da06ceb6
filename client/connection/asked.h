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

// Questions with an id that wait for the way or for their answers: at most `atATime` are on their way, `waiting` wait. Not thread-safe.
template <class Question, class Reply>
class Asked {
 public:
  Asked(std::size_t atATime, std::size_t waiting) : atATime_(atATime), most_(waiting) {}

  std::future<Outcome<Reply>> add(Question question, std::optional<Error> refusal) {
    std::promise<Outcome<Reply>> promise;
    auto future = promise.get_future();
    if (!refusal && waiting_.size() >= most_) refusal = Error{"more than " + std::to_string(most_) + " questions wait for the server"};
    if (refusal) {
      promise.set_value(*refusal);
      return future;
    }
    question.id = ++last_;
    waiting_.emplace_back(std::move(question), std::move(promise));
    return future;
  }
  // The next that may leave.
  std::optional<Question> next() {
    if (waiting_.empty() || open_.size() >= atATime_) return std::nullopt;
    auto [question, promise] = std::move(waiting_.front());
    waiting_.pop_front();
    open_.emplace(question.id, std::move(promise));
    return std::move(question);
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
    for (auto& [question, promise] : waiting_) promise.set_value(error);
    open_.clear();
    waiting_.clear();
  }

 private:
  const std::size_t atATime_, most_;
  std::uint64_t last_ = 0;
  std::deque<std::pair<Question, std::promise<Outcome<Reply>>>> waiting_;
  std::map<std::uint64_t, std::promise<Outcome<Reply>>> open_;
};

}  // namespace ridgecast::connection
