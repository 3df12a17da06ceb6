#pragma once
// Successive conversations with one server: when one ends, the next begins after a pause. The pause grows until a conversation has lasted
// for the longest one, and is random, so that a thousand clients do not reconnect at once. The server may have restarted, or may have sent
// us to another one: servers that leave spread their clients themselves, so the first pause is left out.
// Like Conversation, it has no socket, thread or clock, and is not thread-safe.
//
// The owner switches to the next conversation with goOn(); until then the ended one stays, with what it received before its end. Requests
// and news of an earlier one are void: start over when reconnections() has grown.

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "client/core/conversation/conversation.h"
#include "client/core/conversation/url.h"
#include "common/outcome/contract.h"

namespace ridgecast::core {

// Whether another conversation follows one that ended: never; if there was a world, as long as the server still has it; or always, from the
// first attempt on and into any world.
enum class Returns { kNever, kToItsWorld, kAlways };

class Reconnector {
 public:
  using Instant = Conversation::Instant;
  static constexpr std::chrono::milliseconds kFirstPause{50}, kLongestPause{2000};  // each is multiplied by 0.5 to 1

  // `random` seeds the pauses.
  Reconnector(Url url, wire::Hello hello, Returns returns, std::uint32_t random);

  // ---- the line, one at a time ----

  // The URL to connect to now, if any; opened() or ended() follows.
  std::optional<Url> dial(Instant now);
  std::string opened() const {  // the first frame
    expects(hasLine_, "a line that opened was dialled");
    return ofLine().hello();
  }
  bool isGreeted() const { return ofLine().hasWorld(); }
  // As Conversation's, for the line's.
  Wrong heard(std::span<const std::uint8_t> frame, Instant now);
  std::optional<std::string> next(Instant now) { return ofLine().next(now); }
  std::optional<Instant> due() const;  // also of dial()
  void ended(const Error& why, Instant now);
  void hurry(Instant now);  // the next attempt is now

  // ---- the owner ----

  Conversation& conversation() { return *current_; }
  const Conversation& conversation() const { return *current_; }
  // Later conversations begin with these, too.
  Wrong send(const wire::PoseMessage& pose);
  Wrong change(const wire::Settings& settings);
  Wrong skipSteps(bool skips);

  const std::optional<Error>& lost() const { return lost_; }  // why there is no conversation at the moment
  // The server came back with another world or, unless it plays a recording, without edits that were heard of: what is held is useless
  // there.
  bool otherWorld() const { return otherWorld_; }
  bool comesBack() const {  // if it is lost
    return !speaksOther_ && (returns_ == Returns::kAlways || (returns_ == Returns::kToItsWorld && !otherWorld_ && current_->hasWorld()));
  }
  // The next conversation has its world, and all earlier iterations are taken.
  bool hasReturned() const { return coming_ && coming_->hasWorld() && !current_->hasIterations(); }
  const wire::World& coming() const {
    expects(hasReturned(), "the next conversation has its world");
    return coming_->world();
  }
  // Says first which leaves are `held`, then the newest pose.
  void goOn(const std::vector<wire::Resume>& held);
  std::uint64_t reconnections() const { return reconnections_; }
  std::uint64_t bytes() const { return bytesBefore_ + current_->bytes(); }  // that were received

 private:
  std::unique_ptr<Conversation> begin(const Url& with) const;
  Conversation& ofLine() const { return coming_ ? *coming_ : *current_; }
  void follow(const std::string& sentTo);

  const Url url_;
  Url target_;  // where a leaving server has sent us; url_ again if that fails
  wire::Hello hello_;
  const Returns returns_;
  bool hasLine_ = false, otherWorld_ = false, speaksOther_ = false, skipsSteps_ = false;
  std::unique_ptr<Conversation> current_, coming_;  // coming_: from dial() to goOn(), but for the first
  wire::Settings asked_;                            // when coming_ began
  std::optional<wire::PoseMessage> pose_;
  std::optional<Error> lost_;
  Instant next_{};     // dial()
  Instant greeted_{};  // the line
  std::chrono::milliseconds pause_ = kFirstPause;
  std::minstd_rand random_;
  std::uint64_t bytesBefore_ = 0, reconnections_ = 0;
};

}  // namespace ridgecast::core
