#pragma once
// The queue of messages to the server, and their order. Internal to the room.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"
#include "common/wire/messages.h"
#include "common/wire/wire.h"

namespace ridgecast::core {

using Wrong = std::optional<std::string>;  // a sentence: what is wrong, and what would be right; nothing: no error

inline constexpr std::size_t kMaxPoses = 64;     // queued
inline constexpr std::size_t kMaxWaiting = 256;  // queued, of the clock's messages and of each kind of request

// Requests with an id, queued or awaiting answers: at most `atATime` unanswered, at most `waiting` queued. Not thread-safe.
template <class Request, class Reply>
class PendingRequests {
 public:
  using Done = std::function<void(Outcome<Reply>)>;  // called once
  PendingRequests(std::size_t atATime, std::size_t waiting) : atATime_(atATime), most_(waiting) {
    expects(atATime > 0 && waiting > 0, "requests may wait, and leave");
  }

  void add(Request request, Done done) {
    expects(done != nullptr, "somebody hears the answer to a request");
    if (failed_) return done(*failed_);
    if (waiting_.size() >= most_) return done(Error{"more than " + std::to_string(most_) + " questions wait for the server"});
    request.id = ++last_;
    waiting_.emplace_back(std::move(request), std::move(done));
  }
  // The next that may leave.
  std::optional<Request> next() {
    if (waiting_.empty() || open_.size() >= atATime_) return std::nullopt;
    auto [request, done] = std::move(waiting_.front());
    waiting_.pop_front();
    expects(open_.emplace(request.id, std::move(done)).second, "no two requests have the same id");
    return std::move(request);
  }
  // False: it is no answer to a request.
  bool take(Reply reply) {
    auto answered = open_.extract(reply.id);
    if (!answered) return false;
    if (reply.refusal.empty())
      answered.mapped()(std::move(reply));
    else
      answered.mapped()(Error{std::move(reply.refusal)});
    return true;
  }
  // Fails all, and those to come.
  void fail(const Error& error) {
    failed_ = error;
    for (auto& [id, done] : std::exchange(open_, {})) done(error);
    for (auto& [request, done] : std::exchange(waiting_, {})) done(error);
  }

 private:
  const std::size_t atATime_, most_;
  std::uint64_t last_ = 0;
  std::deque<std::pair<Request, Done>> waiting_;
  std::map<std::uint64_t, Done> open_;
  std::optional<Error> failed_;
};

class Outbox {
 public:
  explicit Outbox(wire::Pacing pacing) : pacing_(pacing) {}

  // Error: too many are queued.
  [[nodiscard]] Wrong put(const wire::PoseMessage& pose);
  [[nodiscard]] Wrong put(wire::ClientMessage message);  // of the clock

  void put(const wire::Acknowledge& acknowledge) { acknowledge_ = acknowledge; }  // replaces an earlier one
  void put(const wire::Resume& resume) { resumes_.push_back(resume); }            // bounded by the owner's scene
  void put(const wire::ResendLeaves& resend);                                     // added to those queued
  void put(const wire::WantTiles& wanted) { wants_.push_back(wanted); }           // bounded by what may be unanswered
  void put(const wire::WantSquares& wanted) { wants_.push_back(wanted); }         // the same
  void put(const wire::FindEdits& find) { wants_.push_back(find); }               // the same
  void put(const wire::Settings& settings) { settings_ = settings; }              // replaces earlier ones

  // The most urgent message; nothing when none may leave now.
  std::optional<wire::ClientMessage> next();

  PendingRequests<wire::Query, wire::Answer> queries{wire::kMaxQueries, kMaxWaiting};
  PendingRequests<wire::AskGround, wire::Ground> grounds{wire::kMaxGrounds, kMaxWaiting};
  PendingRequests<wire::Edit, wire::EditAnswer> edits{wire::kMaxEdits, kMaxWaiting};

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

}  // namespace ridgecast::core
