#pragma once
// Internal to the room: checking what is read, and the messages that stand in a file of their own (session.cpp: members, clock, queries,
// grounds and candidates).

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"
#include "ridgecast/v1/stream.pb.h"

namespace ridgecast::wire {

namespace pb = ridgecast::v1;

// The first thing that is wrong is what the error says.
class Check {
 public:
  void require(bool ok, const char* field, const std::string& right) {
    if (!ok && !error_) error_ = Error{std::string(field) + " " + right};
  }
  void finite(double v, double low, double high, const char* field, const char* right) {
    require(std::isfinite(v) && v >= low && v <= high, field, right);
  }
  void text(const std::string& s, std::size_t most, const char* field) {
    require(s.size() <= most, field, "has " + std::to_string(s.size()) + " bytes, at most " + std::to_string(most) + " are allowed");
    const bool printable = std::none_of(s.begin(), s.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; });
    require(printable, field, "must not contain control characters");
  }
  void count(std::size_t n, std::size_t most, const char* field) {
    require(n <= most, field, "has " + std::to_string(n) + " entries, at most " + std::to_string(most) + " are allowed");
  }
  const std::optional<Error>& error() const { return error_; }

 private:
  std::optional<Error> error_;
};

PoseMessage read(const pb::Pose& in, Check& check);
LeafWhole read(pb::LeafWhole& in, Check& check);
void write(const PoseMessage& in, pb::Pose& out);
void write(const LeafWhole& in, pb::LeafWhole& out);

// In session.cpp. What is swallowed whole is taken by reference.
AskClock read(const pb::AskClock& in);
SetClock read(const pb::SetClock& in, Check& check);
Step read(const pb::Step& in, Check& check);
Query read(const pb::Query& in, Check& check);
AskGround read(const pb::AskGround& in, Check& check);
Members read(const pb::Members& in, Check& check);
Clock read(const pb::Clock& in, Check& check);
Answer read(const pb::Answer& in, Check& check);
Ground read(pb::Ground& in, Check& check);
std::vector<Candidate> read(const pb::Candidates& in, Check& check);

void write(const AskClock& in, pb::ClientMessage& message);
void write(const SetClock& in, pb::ClientMessage& message);
void write(const Step& in, pb::ClientMessage& message);
void write(const StepDone& in, pb::ClientMessage& message);
void write(const Query& in, pb::ClientMessage& message);
void write(const AskGround& in, pb::ClientMessage& message);
void write(const Members& in, pb::ServerMessage& message);
void write(const Clock& in, pb::ServerMessage& message);
void write(const Answer& in, pb::ServerMessage& message);
void write(const Ground& in, pb::ServerMessage& message);
void write(const std::vector<Candidate>& in, pb::Candidates& out);

}  // namespace ridgecast::wire
