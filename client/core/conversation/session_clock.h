#pragma once
// The session's clock as this client knows it: what the server said last, and what time it is now by the client's own steady clock.
//
// While the clock runs, each answer gives the session's time midway between request and response, to half the round trip. The recent answer
// with the shortest round trip counts (Cristian 1989), older ones less and less. Good to half a round trip. A stepped clock is exact. Not
// thread-safe; a value.

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "common/outcome/contract.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

class SessionClock {
 public:
  using Instant = std::chrono::steady_clock::time_point;

  const wire::Clock& said() const { return said_; }          // the last that was heard
  const std::string& notice() const { return notice_; }      // the server's last sentence about it; empty: none yet
  std::uint64_t refused() const { return refused_; }         // version() when it last refused what this member said; 0: it did not
  std::uint64_t version() const { return version_; }         // grows with everything that is heard; 0: nothing yet
  std::uint64_t time(Instant now) const;                     // session time, microseconds
  std::chrono::microseconds uncertainty(Instant now) const;  // of time(): half a round trip, plus the drift of two clocks; 0 when stepped
  bool waitsFor(std::uint64_t camera) const;                 // the newest step is not done before this member says so
  // Whether the last message reflects everything that this client set.
  bool isSettled() const { return waiting_ == 0 && answered_ >= settles_; }

  wire::AskClock ask(Instant now);  // a request to send now; forgets an earlier unanswered one
  void hear(const wire::Clock& clock, Instant now);
  void set() { ++waiting_; }  // wire::SetClock waits to leave
  void setLeft() {            // it has left; the next question comes after it
    expects(waiting_ > 0, "a setting of the clock waited before it left");
    --waiting_;
    settles_ = asked_ + 1;
  }

 private:
  struct Sample {
    Instant at;  // when the session's time was `time`
    double time = 0;
    double spread = 0;  // microseconds, either way
  };
  static double spreadOf(const Sample& sample, Instant now);

  wire::Clock said_;
  std::string notice_;
  std::uint64_t version_ = 0, refused_ = 0, asked_ = 0, answered_ = 0, waiting_ = 0;
  std::uint64_t settles_ = 0;  // the request whose answer settles it
  std::optional<Instant> askedAt_;
  std::optional<Sample> best_;
  double halfTrip_ = 0;  // microseconds, the shortest so far
};

}  // namespace ridgecast::core
