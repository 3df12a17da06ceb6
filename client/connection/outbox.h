#pragma once
// What waits to leave for the server, and in which order it leaves. Internal to the room. Not thread-safe; no thread, socket or clock.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "client/connection/connection.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"
#include "common/wire/wire.h"

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
    if (reply.refusal.empty())
      it->second.set_value(std::move(reply));
    else
      it->second.set_value(Error{std::move(reply.refusal)});
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

class Outbox {
 public:
  explicit Outbox(wire::Pacing pacing) : pacing_(pacing) {}

  // What waits in too large a number, if anything, and what would be right.
  [[nodiscard]] std::optional<std::string> put(const wire::PoseMessage& pose);
  [[nodiscard]] std::optional<std::string> put(wire::ClientMessage message);  // of the clock

  void put(const wire::Acknowledge& acknowledge) { acknowledge_ = acknowledge; }  // in the place of an earlier one
  void put(const wire::Resume& resume) { resumes_.push_back(resume); }            // the owner's scene bounds them
  void put(const wire::ResendLeaves& resend);                                     // beside those that wait
  void put(const wire::WantTiles& wanted) { wants_.push_back(wanted); }           // bounded by what may be unanswered
  void put(const wire::WantSquares& wanted) { wants_.push_back(wanted); }         // the same
  void put(const wire::FindEdits& find) { wants_.push_back(find); }               // the same
  void put(const wire::Settings& settings) { settings_ = settings; }              // in the place of earlier ones

  // The most urgent message; nothing when none may leave now.
  std::optional<wire::ClientMessage> next();

  PendingRequests<wire::Query, wire::Answer> queries{wire::kMaxQueries, Connection::kMaxWaiting};
  PendingRequests<wire::AskGround, wire::Ground> grounds{wire::kMaxGrounds, Connection::kMaxWaiting};
  PendingRequests<wire::Edit, wire::EditAnswer> edits{wire::kMaxEdits, Connection::kMaxWaiting};

 private:
  const wire::Pacing pacing_;
  std::deque<wire::Resume> resumes_;
  std::optional<wire::ResendLeaves> resend_;
  std::optional<wire::Acknowledge> acknowledge_;
  std::deque<wire::ClientMessage> wants_;
  std::optional<wire::Settings> settings_;
  std::deque<wire::PoseMessage> poses_;
  std::deque<wire::ClientMessage> messages_;
};

}  // namespace ridgecast::connection
