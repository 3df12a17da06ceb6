#pragma once
// What waits to leave for the server, and in which order it leaves. Internal to the room. Not thread-safe; no thread, socket or clock.

#include <cstddef>
#include <deque>
#include <optional>
#include <string>

#include "client/connection/connection.h"
#include "client/connection/pending_requests.h"
#include "common/wire/messages.h"
#include "common/wire/wire.h"

namespace ridgecast::connection {

class Outbox {
 public:
  explicit Outbox(wire::Pacing pacing) : pacing_(pacing) {}

  // What there is too much of, if anything: then the server does not read.
  [[nodiscard]] std::optional<std::string> put(const wire::PoseMessage& pose);
  [[nodiscard]] std::optional<std::string> put(wire::ClientMessage message);  // of the clock

  void put(const wire::Acknowledge& acknowledge) { acknowledge_ = acknowledge; }  // in the place of an earlier one
  void put(const wire::Resume& resume) { resumes_.push_back(resume); }            // the owner's scene bounds them
  void put(const wire::ResendLeaves& resend);                                     // beside those that wait
  void put(const wire::WantTiles& wanted) { wants_.push_back(wanted); }           // bounded by what may be unanswered
  void put(const wire::Settings& settings) { settings_ = settings; }              // in the place of earlier ones

  // The most urgent message; nothing when none may leave now.
  std::optional<wire::ClientMessage> next();

  PendingRequests<wire::Query, wire::Answer> queries{wire::kMaxQueries, Connection::kMaxWaiting};
  PendingRequests<wire::AskGround, wire::Ground> grounds{wire::kMaxGrounds, Connection::kMaxWaiting};

 private:
  const wire::Pacing pacing_;
  std::deque<wire::Resume> resumes_;
  std::optional<wire::ResendLeaves> resend_;
  std::optional<wire::Acknowledge> acknowledge_;
  std::deque<wire::WantTiles> wants_;
  std::optional<wire::Settings> settings_;
  std::deque<wire::PoseMessage> poses_;
  std::deque<wire::ClientMessage> messages_;
};

}  // namespace ridgecast::connection
