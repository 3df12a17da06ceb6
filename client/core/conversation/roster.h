#pragma once
// The other members of the session, as far as this client has heard: those near it by name, in a crowd the others as counts. Not
// thread-safe; a value.

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "common/outcome/outcome.h"
#include "common/wire/messages.h"

namespace ridgecast::core {

struct Other {
  wire::Member member;
  std::chrono::steady_clock::time_point heard;  // when the newest of it arrived
};

// "Guest 7" if a program's name is all that is known.
std::string nameOf(const wire::Member& member);

class Roster {
 public:
  // Error: a member joins twice, or moves, leaves or fades without having joined; nothing is applied then.
  Outcome<void> apply(const wire::Members& news, std::chrono::steady_clock::time_point now);
  const std::map<std::uint64_t, Other>& others() const { return others_; }  // named, by camera; not this client itself
  std::size_t count() const { return std::max(count_, others_.size()); }    // of all others, named or not
  // How many of all members are where; empty: all that have a place are named.
  const wire::Crowd& crowd() const { return crowd_; }
  std::uint64_t version() const { return version_; }  // grows with everything that is applied; 0: nothing yet

 private:
  std::map<std::uint64_t, Other> others_;
  std::size_t count_ = 0;
  wire::Crowd crowd_;
  std::uint64_t version_ = 0;
};

}  // namespace ridgecast::core
